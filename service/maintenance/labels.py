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
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def labels_csv(labels: Iterable[Feedback]) -> str:
    """One line for each label under ``COLUMNS``; a text that a spreadsheet would take for a formula
    begins with an apostrophe."""
    memory = io.StringIO()
    out = csv.writer(memory, lineterminator="\n")
    out.writerow(COLUMNS)
    for label in labels:
        start, end = label.window
        out.writerow(
            [
                _text(label.valve),
                _time(start),
                _time(end),
                _time(label.screened),
                _text(label.source),
                label.verdict.value,
                "|".join(label.effects),
                _number(label.S),
                _number(label.J),
                label.judgement.value,
                _text(label.found),
                _text(label.who),
                _time(label.at),
                label.software_version,
            ]
        )
    return memory.getvalue()


def _text(text: str) -> str:
    clean = printable(text)
    return f"'{clean}" if clean.startswith(_FORMULA) else clean


def _time(moment: datetime | None) -> str:
    return "" if moment is None else moment.isoformat()


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"
