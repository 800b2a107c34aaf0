"""Several recordings of one valve are told apart, and counted as one valve, in every output."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from stemwatch.models.recording import Provenance
from stemwatch.service.cli import screening_views as views
from stemwatch.service.maintenance.maintenance_html import work_list_html
from stemwatch.service.maintenance.work_list import work_list_of
from stemwatch.service.report import write_report
from stemwatch.service.report.ranking import rank_valves
from tests.service.maintenance.example_work_list import context
from tests.service.presenter.every_kind import (
    NO_POSITION,
    blind,
    brief_ranking,
    csv_rows,
    json_objects,
    text_of,
    workbook_rows,
)
from tests.service.report.conftest import screening

pytestmark = pytest.mark.filterwarnings("ignore:.*:DeprecationWarning:openpyxl")


def test_recordings_of_one_valve_are_told_apart_and_counted_as_one(tmp_path: Path) -> None:
    """Three files of one tag are one valve with one page and one order; wherever each recording has
    a row of its own, the file says which it is, and rows are counted as recordings."""
    files = ("june.txt", "july.txt", "august.txt")
    several = [
        replace(blind("LIC-1", NO_POSITION), provenance=Provenance(source=f"exports/{file}"))
        for file in files
    ]
    every = [*several, screening("FIC-1", S=6.0)]
    ranked = rank_valves(every, context(every))
    assert (ranked.counts.valves, ranked.counts.recordings) == (2, 4)
    assert ranked[0].recording == ""
    named = {valve.recording for valve in ranked[1:]}
    assert named == {f"{file}, 2026-03-02 07:00" for file in files}
    written = write_report(every, context(every), tmp_path)
    sources = [(valve.screening.valve, valve.screening.provenance.source) for valve in ranked]
    for rows in (csv_rows(written.csv), workbook_rows(written.xlsx), json_objects(tmp_path)):
        assert [(row["valve"], row["recording"]) for row in rows] == sources
    report = written.html.read_text("utf-8")
    table = report[report.index('id="ranking-table"') :]
    table = table[: table.index("</table>")]
    terminal = list(views.summary(brief_ranking(every)).columns[1].cells)
    for file in files:
        assert table.count(file) == 1
        assert [f"LIC-1\n{file}" in str(cell) for cell in terminal].count(True) == 1
    assert ">4 recordings</output>" in report
    assert "3 without a state" not in text_of(report)
    assert "Of the recordings:" in text_of(report)
    assert "1 out of specification, 1 without a state" in text_of(report)
    listed = work_list_of(every, context(every))
    assert [sheet.screening.valve for sheet in listed.sheets] == ["FIC-1", "LIC-1"]
    assert listed.to_work_on == listed.sheets
    page = text_of(work_list_html(listed).decode())
    assert "The most urgent of 3 recordings:" in page
    assert ranked.counts.sentence in page
    assert ranked.counts.sentence.startswith("1 of 2 valves needs work; 1 cannot be judged (1 with")
    assert ranked.counts.sentence.endswith("(4 recordings).")
    (line, *_) = views.undetermined_lines(every)
    assert line.count("LIC-1") == 1


def test_valves_in_the_terminal_are_numbered_without_gaps() -> None:
    """Where nothing has a verdict each valve has one line, whatever its recordings."""
    several = [
        replace(blind("LIC-1", NO_POSITION), provenance=Provenance(source=f"exports/{month}.txt"))
        for month in ("june", "july")
    ]
    ranking = brief_ranking([*several, blind("LIC-2", NO_POSITION)])
    assert list(views.summary(ranking).columns[0].cells) == ["1", "2"]
