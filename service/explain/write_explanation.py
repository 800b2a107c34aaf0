"""``write_pages``: the folder of an explanation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path

from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.explain.explain_json import to_json
from stemwatch.service.explain.explain_recording import Explained
from stemwatch.service.presenter.wording import span_percent
from stemwatch.service.report import ReportContext
from stemwatch.service.report.heatmap import heat_map
from stemwatch.service.report.html_page import PLOT_SCRIPTS, environment, inlined, template
from stemwatch.service.report.mismatch_view import MismatchView, mismatch_view
from stemwatch.service.report.ranking import anchor_of
from stemwatch.service.whole_files import put_all

HERE = "stemwatch.service.explain"
# An overlay is 60 to 90 KB, and the page must open on a phone.
MOST_PLOTTED = 150

PAGE, OBJECTS, MAPS = "explain.html", "explain.json", "maps"


@dataclass(frozen=True, kw_only=True)
class ExplainedEntry:
    """One explanation with what the page shows of it."""

    explained: Explained
    view: MismatchView


def entries(valves: Sequence[Explained]) -> list[ExplainedEntry]:
    """The explanations in their order, each with an anchor that no other has."""
    used_anchors: Counter[str] = Counter()
    return [_entry(explained, index, used_anchors) for index, explained in enumerate(valves)]


def html_bytes(explained_entries: Sequence[ExplainedEntry], context: ReportContext) -> bytes:
    """The page as UTF-8."""
    counts = Counter(entry.explained.mismatch.finding for entry in explained_entries)
    templates = environment(context, _load)
    templates.filters["change"] = change
    page = templates.get_template("explain.html")
    text = page.render(
        context=context,
        entries=explained_entries,
        counts={finding: counts[finding] for finding in Finding if counts[finding]},
        most_plotted=MOST_PLOTTED,
        compact=False,
        **inlined(PLOT_SCRIPTS),
    )
    return text.encode()


def change(before: float | None, after: float | None) -> str:
    """``11.8 → 1.00``; one number where both are written alike."""
    first, second = span_percent(before), span_percent(after)
    return first if first == second else f"{first} → {second}"


def _entry(explained: Explained, number: int, used_anchors: Counter[str]) -> ExplainedEntry:
    recording = explained.recording if number < MOST_PLOTTED else None
    anchor = anchor_of(explained.valve, used_anchors)
    return ExplainedEntry(
        explained=explained,
        view=mismatch_view(
            explained.mismatch,
            recording,
            anchor,
            explained.valve,
            by_window=explained.by_window,
        ),
    )


@cache
def _load(name: str) -> str:
    """A template of this page, or one of the report's."""
    source = files(HERE).joinpath(name)
    return source.read_text("utf-8") if source.is_file() else template(name)


@dataclass(frozen=True, kw_only=True)
class ExplanationFiles:
    """Where the page, the JSON and the maps were written."""

    html: Path
    json: Path
    maps: tuple[Path, ...]


def write_pages(
    valves: Sequence[Explained], context: ReportContext, folder: Path
) -> ExplanationFiles:
    """Write ``explain.html``, ``explain.json`` and ``maps/VALVE-before.svg``, ``-after.svg``.

    Raises ``ReportNotWritten``, after writing what can be written, with each file and what to do.
    """
    all_entries = entries(valves)
    maps = {path: text for entry in all_entries for path, text in _maps(entry, folder / MAPS)}
    for parent in {folder, *(path.parent for path in maps)}:
        parent.mkdir(parents=True, exist_ok=True)
    pages = ExplanationFiles(html=folder / PAGE, json=folder / OBJECTS, maps=tuple(maps))
    put_all(
        {
            pages.json: to_json(valves).encode(),
            **maps,
            pages.html: html_bytes(all_entries, context),
        }
    )
    return pages


def _maps(entry: ExplainedEntry, folder: Path) -> list[tuple[Path, bytes]]:
    mismatch, view = entry.explained.mismatch, entry.view
    named = (("before", mismatch.before), ("after", mismatch.after))
    pictures = [
        (
            f"{view.anchor}-{name}.svg",
            heat_map(residuals, view.top, f"{view.tag}, {name}", alone=True),
        )
        for name, residuals in named
    ]
    return [(folder / name, str(svg).encode()) for name, svg in pictures if svg is not None]
