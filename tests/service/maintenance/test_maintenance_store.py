"""The report of what is stored: a run, or each valve's latest look, with its history."""

from __future__ import annotations

import csv
from dataclasses import replace
from datetime import timedelta

import pytest

from stemwatch.connectors.settings import Problem
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.verdict import Verdict
from stemwatch.service.config import load_plant
from stemwatch.service.maintenance.drawing import DrawnLine
from stemwatch.service.maintenance.pdf import work_list_pdf
from stemwatch.service.maintenance.stored import (
    background_of,
    report_of_store,
)
from stemwatch.service.maintenance.work_compared import BEFORE_DASH
from stemwatch.service.report.charts.window_pictures import pack_pictures, window_pictures
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.store import open_store
from tests.service.example_mismatches import named
from tests.service.maintenance.example_work_list import text_of_pdf
from tests.service.report.conftest import START, screening

WEEK = timedelta(days=7)
MISTAKE = Problem(file="plant.toml", line=3, key="id", found="?", expected="a text")


@pytest.fixture
def store(tmp_path):
    """An empty store."""
    with open_store(f"sqlite:///{tmp_path / 'store.db'}") as opened:
        yield opened


def looked(store, weeks: int, *screenings) -> int:
    """A run over these valves, some weeks later; its number."""
    number = store.begin_run(software_version="1")
    for earlier in screenings:
        moved = replace(earlier.recording, start=START + weeks * WEEK)
        store.save(replace(earlier, recording=moved), number)
    store.finish_run(number)
    return number


def short(valve: str, verdict: Verdict, S: float = 4.0, **changes):
    """A screening of a minute of samples."""
    return replace(screening(valve, verdict, S=S, J=0.4 * S, samples=60), **changes)


STICKY = short("FV-1", Verdict.STICKY)
HEALTHY = short("FV-2", Verdict.HEALTHY, S=0.2)


@pytest.fixture
def weeks(store) -> list[int]:
    """Three weekly runs: FV-1 healthy, then sticky twice; FV-2 healthy."""
    store.save_valves([StoredValve(id="FV-1", description="Reactor feed", area="A", criticality=3)])
    first = looked(store, 0, short("FV-1", Verdict.HEALTHY, S=0.3), HEALTHY)
    return [first, looked(store, 1, STICKY, HEALTHY), looked(store, 2, STICKY, HEALTHY)]


def test_the_latest_look_of_each_valve_is_reported(store, weeks, tmp_path):
    """With its history, its facts, and no picture where no samples are kept."""
    files = report_of_store(store, tmp_path / "out")
    (sheet,) = files.work_list.sheets
    assert sheet.screening.valve == "FV-1"
    assert sheet.since.count == 2
    assert sheet.since.first.run == weeks[1]
    assert sheet.since.before.run == weeks[0]
    assert sheet.valve.facts.description == "Reactor feed"
    assert sheet.valve.facts.criticality == "3"
    assert sheet.valve.trend.direction == "same"
    assert sheet.picture is None
    assert "not kept" in files.html.read_text("utf-8")
    assert [other.valve for other in files.work_list.others] == ["FV-2"]


def test_a_run_is_reported_as_it_was(store, weeks, tmp_path):
    """What came later is not known to it."""
    files = report_of_store(store, tmp_path / "out", run=weeks[1], zone="Europe/Berlin")
    (sheet,) = files.work_list.sheets
    assert sheet.since.count == 1
    assert sheet.run == weeks[1]
    assert sheet.valve.trend.words == "worse, was healthy"
    assert files.work_list.context.zone == "Europe/Berlin"
    with files.csv.open(encoding="utf-8-sig", newline="") as file:
        assert [row["run"] for row in csv.DictReader(file)] == [str(weeks[1])]


def test_a_valve_or_a_run_that_is_not_there_is_named_with_what_is(store, weeks, tmp_path):
    """Nothing is written."""
    with pytest.raises(StoreError, match=r"no screening of 'FV-9'; it has 2 valves, such as FV-1"):
        report_of_store(store, tmp_path / "out", valves=["FV-9"])
    with pytest.raises(StoreError, match="no run 99"):
        report_of_store(store, tmp_path / "out", run=99)
    assert not (tmp_path / "out").exists()


def test_no_work_is_ordered_on_a_valve_that_left_the_plant_file(store, weeks, tmp_path):
    """One that was removed or has another name by now, unless it is asked for by its name; while
    the file has mistakes nothing is left out."""
    file = tmp_path / "plant.toml"
    source = '[[sources]]\nname = "s"\npath = "*.csv"\n'
    tag = '[valves.tags.op]\ntag = "OP"\nunit = "%"\n'
    file.write_text(f'{source}[[valves]]\nid = "FV-2"\nsource = "s"\n{tag}', encoding="utf-8")
    plant = load_plant(file, environment={})
    assert plant.problems == ()
    files = report_of_store(store, tmp_path / "out", plant=plant)
    assert (files.left_out, files.work_list.sheets) == (("FV-1",), ())
    assert [other.valve for other in files.work_list.others] == ["FV-2"]
    asked = report_of_store(store, tmp_path / "one", plant=plant, valves=["FV-1"])
    assert [sheet.screening.valve for sheet in asked.work_list.sheets] == ["FV-1"]
    in_doubt = replace(plant, problems=(MISTAKE,))
    assert report_of_store(store, tmp_path / "all", plant=in_doubt).left_out == ()


def test_what_stands_is_decided_over_all_valves_also_for_one(store, tmp_path):
    """A page of one valve says the same as the page of the plant."""
    weak = replace(named(), p_value=0.03)
    valve = short("FV-1", Verdict.WATCH, S=1.2, mismatch=weak)
    tested = replace(named(), finding=Finding.NONE, effects=(), p_value=None)
    others = [short(f"H-{k}", Verdict.HEALTHY, S=0.2, mismatch=tested) for k in range(9)]
    looked(store, 0, valve, *others)
    assert report_of_store(store, tmp_path / "all").work_list.to_work_on == ()
    item = report_of_store(store, tmp_path / "one", valves=["FV-1"], all_valves=True)
    assert item.work_list.sheets[0].valve.stands is False
    assert "held back" in item.html.read_text("utf-8")


def test_work_on_a_valve_is_told(store, weeks, tmp_path):
    """Between the healthy and the first sticky look."""
    store.record_maintenance("FV-1", START + 0.5 * WEEK, "packing <renewed>", "M. Weiß")
    html = report_of_store(store, tmp_path).html.read_text("utf-8")
    assert "packing &lt;renewed&gt;. It came 3 days after that work." in html


def test_a_stored_screening_is_whole_where_it_gets_a_page(store):
    """Of healthy valves with nothing named only the verdict of the mismatch is read."""
    selection = named()
    nothing = replace(selection, finding=Finding.NONE, effects=(), p_value=None)
    number = looked(
        store,
        0,
        replace(STICKY, mismatch=selection),
        replace(HEALTHY, mismatch=nothing),
    )
    sticky, healthy = store.screenings_of_run(number)
    assert sticky.mismatch.effects == selection.effects
    assert sticky.window == (START, START + timedelta(seconds=60))
    assert healthy.mismatch.finding is Finding.NONE
    assert store.latest_screenings() == [sticky, healthy]


def test_a_recording_without_dates_is_not_its_own_past(store):
    """Its row is the newest one; what lies before it is earlier."""
    looked(store, 0, STICKY)
    number = store.begin_run(software_version="1")
    undated = replace(STICKY, recording=replace(STICKY.recording, start=None))
    store.save(undated, number)
    (past,) = background_of(store).earlier(undated)
    assert past.at == START + timedelta(seconds=60)


def test_loops_before_and_after_the_last_work_are_laid_over_each_other(store, weeks, tmp_path):
    """In HTML and PDF, with what was done and S and J of both windows, for the run that saw the
    valve after it; the run before knows nothing of it."""
    del weeks
    runs = []
    for week, S in ((3, 6.25), (4, 0.31)):
        answer = screening("FV-3", Verdict.STICKY, S=S, J=0.4 * S)
        moved = replace(answer, recording=replace(answer.recording, start=START + week * WEEK))
        run = store.begin_run(software_version="1")
        packed = pack_pictures(window_pictures(moved))
        store.save(moved.without_samples(), run, packed_pictures=packed)
        store.finish_run(run)
        runs.append(run)
    store.record_maintenance("FV-3", START + 4 * WEEK - timedelta(days=1), "packing renewed", "")
    before = report_of_store(store, tmp_path / "before", run=runs[0])
    assert before.work_list.done == ()
    assert "Before and after the last work" not in before.html.read_text("utf-8")
    after = report_of_store(store, tmp_path / "after", run=runs[1])
    (item,) = after.work_list.done
    assert item.sizes == ("6.25 → 0.31 %", "2.50 → 0.12 %")
    assert item.drawing is not None
    assert after.work_list.done_title == "Before and after the last work"
    assert "12 newest of 30" in replace(after.work_list, done=(item,) * 12, worked=30).done_title
    dashes = {mark.dash for mark in item.drawing.marks if isinstance(mark, DrawnLine)}
    assert dashes == {(), BEFORE_DASH}  # told apart on a copy of a copy
    text = after.html.read_text("utf-8")
    part = text[text.index("Before and after the last work") :]
    for result in ("FV-3", "packing renewed", "S 6.25 → 0.31 %", "the latest one, until", "<svg "):
        assert result in part[: part.index("</section>")]
    paper = work_list_pdf(after.work_list, compress=False)
    result = text_of_pdf(paper)
    for word in ("packing renewed", "before the work", "after it"):
        assert word in result
