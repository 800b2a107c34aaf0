"""``write_report``: the four files of one run."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from stemwatch.models.findings import Screening
from stemwatch.service.report.context import ReportContext
from stemwatch.service.report.contract import to_contract
from stemwatch.service.report.csv_file import csv_bytes
from stemwatch.service.report.page import html_bytes
from stemwatch.service.report.ranking import RankedValve, rank_valves
from stemwatch.service.report.xlsx_file import xlsx_bytes


@dataclass(frozen=True, kw_only=True)
class ReportFiles:
    """Where the report was written."""

    html: Path
    csv: Path
    xlsx: Path
    json: Path


class ReportNotWritten(OSError):
    """One or more files of the report could not be written; the others are complete."""


Render = Callable[[Sequence[RankedValve], ReportContext], bytes]


def write_report(
    screenings: Sequence[Screening], context: ReportContext, out_dir: Path | str
) -> ReportFiles:
    """Write ``report.html``, ``valves.csv``, ``valves.xlsx`` and ``valves.json`` into ``out_dir``.

    The folder is made where it is absent; each file is replaced whole or left as it was. Raises
    ``ReportNotWritten``, after writing what can be written, with each file and what to do.
    """
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    files = ReportFiles(
        html=folder / "report.html",
        csv=folder / "valves.csv",
        xlsx=folder / "valves.xlsx",
        json=folder / "valves.json",
    )
    renders: list[tuple[Path, Render]] = [
        (files.json, json_bytes),
        (files.csv, csv_bytes),
        (files.xlsx, xlsx_bytes),
        (files.html, html_bytes),
    ]
    ranked = rank_valves(screenings, context)
    put_all({path: render(ranked, context) for path, render in renders})
    return files


def put_all(contents: Mapping[Path, bytes]) -> None:
    """Write every file whole or leave it as it was.

    Raises ``ReportNotWritten``, after writing what can be written, with each file and what to do.
    """
    failures = [_put(path, content) for path, content in contents.items()]
    if said := [failure for failure in failures if failure]:
        raise ReportNotWritten(" ".join(said))


def json_bytes(ranked: Sequence[RankedValve], context: ReportContext) -> bytes:
    """The contract objects, worst valve first, as UTF-8 JSON without NaN."""
    objects = [to_contract(valve.screening, stands=valve.stands) for valve in ranked]
    return json.dumps(objects, allow_nan=False, ensure_ascii=False, indent=1).encode()


def _put(path: Path, content: bytes) -> str:
    """Write beside, then rename, so that nobody opens half a report. Returns what went wrong."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        beside.write_bytes(content)
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        return (
            f"{path}: could not be written ({error.strerror or error}); "
            "close the program that has it open, or choose another folder, and run again."
        )
    return ""
