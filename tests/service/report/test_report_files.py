"""The four files of a report: whole, in agreement, and safe to open."""

from __future__ import annotations

import csv
import errno
import json
import math
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import openpyxl
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Role, Signal
from stemwatch.models.verdict import Verdict
from stemwatch.service.report import ReportNotWritten, ValveFacts, to_contract, write_report
from stemwatch.service.report.csv_file import harmless

SCHEMA = json.loads(
    (Path(write_report.__code__.co_filename).parent / "contract.schema.json").read_text("utf-8")
)

HOSTILE = (
    "<script>alert(1)</script>",
    "\"'><img src=x onerror=alert(1)>",
    "=cmd|' /C calc'!A0",
    "@SUM(1+1)",
    "صمام‮التحكم",
    "🔥valve🔧",
    "V" * 300,
    "tag\x00with\x07controls",
    "undecodable\udce4name",
    "{{ 7 * 7 }}</script>",
)


def csv_rows(path):
    with path.open(encoding="utf-8-sig", newline="") as file:
        return list(csv.DictReader(file))


def sheet_rows(path, name="Ranking"):
    head, *rows = openpyxl.load_workbook(path)[name].iter_rows(values_only=True)
    return [dict(zip(head, row, strict=True)) for row in rows]


@pytest.fixture
def written(mixed_plant, make_context, tmp_path):
    return write_report(mixed_plant, make_context(mixed_plant), tmp_path / "out")


def test_csv_xlsx_and_json_say_the_same(written):
    """The three files hold the same valves in the same order with the same numbers."""
    objects = json.loads(written.json.read_text("utf-8"))
    flat, sheet = csv_rows(written.csv), sheet_rows(written.xlsx)
    assert len(objects) == len(flat) == len(sheet) == 14
    for item, row, cells in zip(objects, flat, sheet, strict=True):
        assert item["valve"] == row["valve"] == cells["valve"]
        assert item["verdict"] == row["verdict"] == cells["verdict"]
        S = item["stiction"]["S"]["value"]
        # A workbook keeps 16 significant digits.
        assert S == (cells["S (%)"] and pytest.approx(cells["S (%)"], rel=1e-15))
        assert S == (float(row["S (%)"]) if row["S (%)"] else None)
        assert item["reason"] == row["reason"] == cells["reason"]


def test_the_worst_valve_stands_first(written):
    """Those with a work order by their priority, the others behind them."""
    objects = json.loads(written.json.read_text("utf-8"))
    priorities = [item["priority"] or 5 for item in objects]
    assert sorted(priorities) == priorities
    assert objects[0]["verdict"] == Verdict.STICKY
    assert objects[-1]["verdict"] == Verdict.HEALTHY


def test_json_objects_follow_the_schema(written):
    """Every object of a mixed plant validates against the published schema."""
    jsonschema.validate(json.loads(written.json.read_text("utf-8")), SCHEMA)


def test_the_schema_refuses_a_number_without_a_value_or_a_reason(make_screening):
    """An estimate with neither a value nor a reason is not in the contract."""
    contract = to_contract(make_screening("FV-1"))
    contract["stiction"]["S"] |= {"value": None, "reason": None}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate([contract], SCHEMA)


def test_nan_and_infinity_become_null(make_screening):
    """Non-finite numbers reach the contract as null, S with a reason of its own."""
    odd = replace(
        make_screening("FV-1"),
        severity=float("nan"),
        S=Estimate(value=float("inf"), low=1.0, high=float("inf"), unit="%"),
    )
    contract = to_contract(odd)
    assert contract["severity"] is None
    assert contract["indicators"]["fit_percent"]["value"] is None
    assert contract["stiction"]["S"]["value"] is None
    assert contract["stiction"]["S"]["reason"] == "the fit gave no finite number"
    jsonschema.validate([json.loads(json.dumps(contract, allow_nan=False))], SCHEMA)


def test_the_contract_names_its_fields(make_screening):
    """Version 2 has exactly these fields; a reader may rely on them."""
    contract = to_contract(make_screening("FV-1"))
    later = {
        "mismatch",
        "over_weeks",
        "cost_of_sticking",
        "oscillates_with",
        "ne107",
        "response",
        "without_position",
        "path",
        "histograms",
        "trend",
        "priority",
    }  # not in the first reports of this version
    assert set(SCHEMA["$defs"]["screening"]["required"]) | later == set(contract)
    assert contract["version"] == 2
    assert contract["recording"] == "exports/FV-1.csv"
    assert contract["window"]["start"] == "2026-03-02T06:00:00+00:00"
    assert set(contract["residuals"]["narx"]) == {"rmse", "normalised", "fit", "one_step"}
    assert set(contract["residuals"]["stiction"]) == {"rmse", "normalised", "fit"}
    assert math.isclose(contract["residuals"]["stiction"]["fit"], 97.9)
    assert contract["residuals"]["baseline"] is None


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_tags_reach_every_file_as_text(name, make_screening, make_context, tmp_path):
    """A tag or a description is never a formula, never markup, never a reason to fail."""
    valves = [make_screening(name, samples=50)]
    context = make_context(valves, valves={name: ValveFacts(description=name, area=name)})
    files = write_report(valves, context, tmp_path)
    changed = name.translate({0: "�", 7: "�"}).replace("\udce4", "�")
    assert json.loads(files.json.read_text("utf-8"))[0]["valve"] == changed
    assert csv_rows(files.csv)[0]["service"].removeprefix("'") == changed
    page = files.html.read_text("utf-8")
    assert "<img src=x" not in page
    assert "<script>alert" not in page
    cells = openpyxl.load_workbook(files.xlsx)["Ranking"]
    assert {cell.data_type for row in cells.iter_rows() for cell in row} <= {"s", "n", "d"}
    assert sheet_rows(files.xlsx)[0]["valve"] == changed


@pytest.mark.parametrize("start", ["=1+1", "+1", "-1", "@A1", "\t=1", "\r=1", "＝1"])
def test_csv_text_that_a_spreadsheet_would_run_gets_an_apostrophe(start):
    """Each formula start is disarmed; numbers and plain text are left alone."""
    assert harmless(start) == "'" + start
    assert harmless(-1.5) == -1.5
    assert harmless("FV-101") == "FV-101"


def test_no_screenings_give_a_report_that_says_so(make_context, tmp_path):
    """An empty run writes all four files, and the page tells why it is empty."""
    files = write_report([], make_context([]), tmp_path)
    page = files.html.read_text("utf-8")
    assert json.loads(files.json.read_text("utf-8")) == []
    assert csv_rows(files.csv) == []
    assert sheet_rows(files.xlsx) == []
    assert "No valve was screened" in page
    assert "It is not a table of numbers." in page


def test_a_signal_of_nothing_but_gaps_is_a_row_like_any_other(
    make_screening, make_context, tmp_path
):
    """A valve whose OP is NaN throughout keeps its place, without plots."""
    empty = make_screening("FV-1", Verdict.UNDETERMINED, samples=60)
    signals = {Role.OP: Signal.good(np.full(60, np.nan), "FV-1.OP")}
    empty = replace(empty, recording=replace(empty.recording, signals=signals))
    files = write_report([empty], make_context([empty]), tmp_path)
    assert len(csv_rows(files.csv)) == 1
    assert "no samples could be read" in files.html.read_text("utf-8")


def test_times_are_in_the_plants_zone(written):
    """CSV times carry the zone's offset, XLSX times are that zone's clock, as its header says."""
    row, cells = csv_rows(written.csv)[0], sheet_rows(written.xlsx)[0]
    assert row["from (Europe/Berlin)"] == "2026-03-02T07:00:00+01:00"
    assert str(cells["from (Europe/Berlin)"]) == "2026-03-02 07:00:00"


def test_the_workbook_is_ready_to_work_with(written):
    """Frozen header, filter over all rows, indicators per valve, and a sheet that explains."""
    book = openpyxl.load_workbook(written.xlsx)
    assert book.sheetnames == ["Ranking", "Indicators", "Read me"]
    assert book["Ranking"].freeze_panes == "C2"
    assert book["Ranking"].auto_filter.ref.endswith("15")
    assert len(book["Ranking"].conditional_formatting) == 2
    assert {row["unit"] for row in sheet_rows(written.xlsx, "Indicators")} == {
        "% of OP span",
        "1/h",
        "%",
    }
    answer = [cell for row in book["Read me"].iter_rows(values_only=True) for cell in row]
    assert "dead band plus stick band, percent of OP span" in answer
    assert "exports/notes.pdf" in answer


def test_one_locked_file_does_not_cost_the_others(make_screening, make_context, tmp_path):
    """What can be written is written; the error names the rest and says what to do."""
    (tmp_path / "valves.xlsx").mkdir()
    valves = [make_screening("FV-1", samples=50)]
    with pytest.raises(ReportNotWritten) as caught:
        write_report(valves, make_context(valves), tmp_path)
    assert "valves.xlsx: could not be written" in str(caught.value)
    assert "close the program that has it open" in str(caught.value)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "report.html",
        "valves.csv",
        "valves.json",
        "valves.xlsx",
    ]


def test_a_file_system_without_writes_is_said_for_each_file(
    make_screening, make_context, tmp_path, monkeypatch
):
    """Not even what was begun can be removed there; the error still says what to do."""

    def refuse(path, *_args, **_kwargs):
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    valves = [make_screening("FV-1", samples=50)]
    monkeypatch.setattr(Path, "open", refuse)
    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(ReportNotWritten) as caught:
        write_report(valves, make_context(valves), tmp_path)
    for name in ("report.html", "valves.csv", "valves.xlsx", "valves.json"):
        said = f"{name}: could not be written (Read-only file system); make its file system"
        assert said in str(caught.value)


def test_a_folder_that_cannot_be_made_is_said(make_screening, make_context, tmp_path):
    """With what hinders it and what to do."""
    (tmp_path / "file").write_text("a file where a folder should be", encoding="utf-8")
    valves = [make_screening("FV-1", samples=50)]
    with pytest.raises(ReportNotWritten, match=r"file/report: this folder could not be made \("):
        write_report(valves, make_context(valves), tmp_path / "file" / "report")


def test_a_report_can_be_written_again(make_screening, make_context, tmp_path):
    """The same run gives the same bytes, over the files of the run before."""
    valves = [make_screening("FV-1", samples=50)]
    first = write_report(valves, make_context(valves), tmp_path)
    before = [path.read_bytes() for path in (first.html, first.csv, first.xlsx, first.json)]
    repeated = write_report(valves, make_context(valves), tmp_path)
    assert before == [
        path.read_bytes() for path in (repeated.html, repeated.csv, repeated.xlsx, repeated.json)
    ]
