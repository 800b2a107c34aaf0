"""The page of ``stemwatch explain``: what S and J leave out, valve by valve.

It is put together from the report's parts, stands alone like the report and loads nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.explain.explained import Explained
from stemwatch.service.presenter.wording import span_percent
from stemwatch.service.report import ReportContext
from stemwatch.service.report.html_page import PLOT_SCRIPTS, environment, inlined, template
from stemwatch.service.report.mismatch_view import MismatchView, mismatch_view
from stemwatch.service.report.ranking import anchor_of

HERE = "stemwatch.service.explain"
# An overlay is 60 to 90 KB, and the page must open on a phone.
MOST_PLOTTED = 150


@dataclass(frozen=True, kw_only=True)
class ExplainedEntry:
    """One explanation with what the page shows of it."""

    explained: Explained
    view: MismatchView


def entries(found: Sequence[Explained]) -> list[ExplainedEntry]:
    """The explanations in their order, each with an anchor that no other has."""
    taken: Counter[str] = Counter()
    return [_entry(one, place, taken) for place, one in enumerate(found)]


def html_bytes(shown: Sequence[ExplainedEntry], context: ReportContext) -> bytes:
    """The page as UTF-8."""
    counted = Counter(entry.explained.mismatch.finding for entry in shown)
    templates = environment(context, _load)
    templates.filters["change"] = change
    page = templates.get_template("explain.html")
    text = page.render(
        context=context,
        entries=shown,
        counts={finding: counted[finding] for finding in Finding if counted[finding]},
        most_plotted=MOST_PLOTTED,
        compact=False,
        **inlined(PLOT_SCRIPTS),
    )
    return text.encode()


def change(before: float | None, after: float | None) -> str:
    """``11.8 → 1.00``; one number where both are written alike."""
    first, second = span_percent(before), span_percent(after)
    return first if first == second else f"{first} → {second}"


def _entry(one: Explained, place: int, taken: Counter[str]) -> ExplainedEntry:
    recording = one.recording if place < MOST_PLOTTED else None
    anchor = anchor_of(one.valve, taken)
    return ExplainedEntry(
        explained=one, view=mismatch_view(one.mismatch, recording, anchor, one.valve)
    )


@cache
def _load(name: str) -> str:
    """A template of this page, or one of the report's."""
    own = files(HERE).joinpath(name)
    return own.read_text("utf-8") if own.is_file() else template(name)
