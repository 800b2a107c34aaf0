"""``write_report``: the four files of one run."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import BinaryIO

from stemwatch.models.screening_result import Screening
from stemwatch.service.report.charts.valve_plots import ValvePlots
from stemwatch.service.report.csv_file import write_csv
from stemwatch.service.report.html_page import write_html
from stemwatch.service.report.json_contract import to_contract
from stemwatch.service.report.ranking import Ranking, rank_valves
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.report.xlsx_file import write_xlsx
from stemwatch.service.whole_files import make_folder, write_all


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """Where the report was written."""

    html: Path
    csv: Path
    xlsx: Path
    json: Path


Write = Callable[[Ranking, ReportContext, BinaryIO], None]


def write_report(
    screenings: Sequence[Screening],
    context: ReportContext,
    out_dir: Path | str,
    evidence: Callable[[int], ValvePlots | None] = lambda _: None,
) -> ReportFiles:
    """Write ``report.html``, ``valves.csv``, ``valves.xlsx`` and ``valves.json`` into ``out_dir``.

    The folder is made where it is absent; each file is replaced whole or left as it was, and
    written valve by valve. ``evidence`` gives the plots of the screening at a place, where its
    samples were let go. Raises ``ReportNotWritten``, after writing what can be written, with each
    file and what to do.
    """
    folder = Path(out_dir)
    make_folder(folder)
    files = ReportFiles(
        html=folder / "report.html",
        csv=folder / "valves.csv",
        xlsx=folder / "valves.xlsx",
        json=folder / "valves.json",
    )
    writers: dict[Path, Write] = {
        files.json: write_json,
        files.csv: write_csv,
        files.xlsx: write_xlsx,
        files.html: write_html,
    }
    ranked = rank_valves(screenings, context, evidence)
    write_all(
        {path: partial(write, ranked, context) for path, write in writers.items()},
    )
    return files


def write_json(ranked: Ranking, context: ReportContext, file: BinaryIO) -> None:
    """The contract objects, worst valve first, as UTF-8 JSON without NaN: a valve on each line."""
    between = "[\n"
    for valve in ranked:
        contract = to_contract(
            valve.screening,
            stands=valve.stands,
            confirmed=valve.confirmed,
            by_window=valve.facts.by_window,
            zone=context.tz,
            groups=context.groups,
            cost=valve.cost,
            path=valve.facts,
            criticality=valve.facts.criticality,
            weeks=valve.facts.weeks,
            finding=valve.finding,
        )
        # Only without an indent is the text made by compiled code: a third of the time.
        text = json.dumps(contract, allow_nan=False, ensure_ascii=False)
        file.write((between + text).encode())
        between = ",\n"
    file.write(b"\n]" if len(ranked) else b"[]")
