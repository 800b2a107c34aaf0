"""``write_pages``: the folder of an explanation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stemwatch.service.explain.explain_html import ExplainedEntry, entries, html_bytes
from stemwatch.service.explain.explain_json import to_json
from stemwatch.service.explain.explained import Explained
from stemwatch.service.report import ReportContext
from stemwatch.service.report.heatmap import heat_map
from stemwatch.service.report.write_report import put_all

PAGE, OBJECTS, MAPS = "explain.html", "explain.json", "maps"


@dataclass(frozen=True, kw_only=True)
class ExplanationFiles:
    """Where the page, the JSON and the maps were written."""

    html: Path
    json: Path
    maps: tuple[Path, ...]


def write_pages(
    found: Sequence[Explained], context: ReportContext, folder: Path
) -> ExplanationFiles:
    """Write ``explain.html``, ``explain.json`` and ``maps/VALVE-before.svg``, ``-after.svg``.

    Raises ``ReportNotWritten``, after writing what can be written, with each file and what to do.
    """
    shown = entries(found)
    maps = {path: text for entry in shown for path, text in _maps(entry, folder / MAPS)}
    for parent in {folder, *(path.parent for path in maps)}:
        parent.mkdir(parents=True, exist_ok=True)
    pages = ExplanationFiles(html=folder / PAGE, json=folder / OBJECTS, maps=tuple(maps))
    put_all(
        {
            pages.json: to_json(found).encode(),
            **maps,
            pages.html: html_bytes(shown, context),
        }
    )
    return pages


def _maps(entry: ExplainedEntry, folder: Path) -> list[tuple[Path, bytes]]:
    found, view = entry.explained.mismatch, entry.view
    named = (("before", found.before), ("after", found.after))
    pictures = [
        (f"{view.anchor}-{name}.svg", heat_map(one, view.top, f"{view.tag}, {name}", alone=True))
        for name, one in named
    ]
    return [(folder / name, str(svg).encode()) for name, svg in pictures if svg is not None]
