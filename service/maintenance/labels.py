"""Feedback of people as labels: a CSV with the finding and their judgement, for training and
audits.

Times are UTC; S and J in percent of OP span; effects are slugs of the catalogue, joined by ``|``.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from datetime import datetime

from stemwatch.service.presenter.wording import printable
from stemwatch.service.report.csv_file import harmless
from stemwatch.service.store.screenings.feedback import Feedback

LABELS = "labels.csv"
COLUMNS = (
    "valve",
    "window_start",
    "window_end",
    "screened",
    "source",
    "verdict",
    "effects",
    "S_percent",
    "J_percent",
    "judgement",
    "found",
    "who",
    "at",
    "software_version",
)


def labels_csv(labels: Iterable[Feedback]) -> str:
    """One line for each label under ``COLUMNS``; a text that a spreadsheet would take for a formula
    begins with an apostrophe."""
    memory = io.StringIO()
    out = csv.writer(memory)
    out.writerow(COLUMNS)
    for label in labels:
        start, end = label.window
        out.writerow(
            [
                harmless(printable(label.valve)),
                _time(start),
                _time(end),
                _time(label.screened),
                harmless(printable(label.source)),
                label.verdict.value,
                "|".join(label.effects),
                _number(label.S),
                _number(label.J),
                label.judgement.value,
                harmless(printable(label.found)),
                harmless(printable(label.who)),
                _time(label.at),
                label.software_version,
            ]
        )
    return memory.getvalue()


def _time(moment: datetime | None) -> str:
    return "" if moment is None else moment.isoformat()


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
