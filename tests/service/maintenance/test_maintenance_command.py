"""The command, the run and the printer: from a plant file to a page on paper."""

from __future__ import annotations

import re
import threading
from pathlib import Path

import openpyxl
import pytest

from stemwatch.service.config import load_plant
from stemwatch.service.config.problems import PlantFileError
from stemwatch.service.config.schema import Stroke, parse_stroke
from stemwatch.service.maintenance import write_maintenance
from stemwatch.service.maintenance.stored import background_of
from stemwatch.service.run.queue_worker import QueueWorker
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.store import open_store
from tests.service.conftest import BLIND, STICKY
from tests.service.maintenance.example_work_list import BACKGROUND, context, longest, mixed

FILES = ("maintenance.html", "maintenance.pdf", "work-orders.xlsx", "work-orders.csv")


@pytest.fixture
def stroked(plant: Path) -> Path:
    """The small plant, its sticking valve with a stroke."""
    text = plant.read_text("utf-8")
    plant.write_text(
        re.sub(rf'(id = "{STICKY}"\n)', r'\1stroke = "40 mm"\n', text), encoding="utf-8"
    )
    assert load_plant(plant, environment={}).valves[STICKY].stroke == "40 mm"
    return plant


def orders(path: Path) -> dict[str, dict[str, object]]:
    """The work orders of a workbook by their valve."""
    header, *rows = openpyxl.load_workbook(path)["Work orders"].values
    matching = [dict(zip(header, row, strict=True)) for row in rows]
    return {str(row["functional_location"]): row for row in matching}


def test_screening_leaves_the_report_and_the_command_makes_it_again(stemwatch, stroked, tmp_path):
    """The sticking valve with a picture and travel, the one without a position as work too."""
    out = tmp_path / "report"
    assert stemwatch("screen", "--plant", stroked, "--out", out, "--workers", 1).status == 0
    assert {path.name for path in out.iterdir()} >= set(FILES)
    html = (out / "maintenance.html").read_text("utf-8")
    assert html.count("<svg") >= 1
    assert " mm</td>" in html
    first = orders(out / "work-orders.xlsx")
    assert set(first) == {STICKY, BLIND}
    assert first[BLIND]["finding"] == "no_position"
    assert first[STICKY]["stroke"] == "40 mm"
    repeated = tmp_path / "again"
    process = stemwatch("maintenance-report", "--plant", stroked, "--out", repeated)
    assert process.status == 0
    assert "1 of 3 valves needs work; 1 cannot be judged (1 with a work order" in process.out
    assert orders(repeated / "work-orders.xlsx").keys() == first.keys()
    assert orders(repeated / "work-orders.xlsx")[STICKY]["reference"] == first[STICKY]["reference"]


def test_the_command_says_what_it_needs(stemwatch, stroked, tmp_path):
    """A plant or a database, and a run that is there."""
    assert "give --plant plant.toml or --db URL" in stemwatch("maintenance-report").said
    early = stemwatch("maintenance-report", "--plant", stroked, "--out", tmp_path / "o")
    assert early.status == 2
    assert "there is no database at" in early.said
    open_store(load_plant(stroked, environment={}).storage).close()
    process = stemwatch(
        "maintenance-report", "--plant", stroked, "--run", 7, "--out", tmp_path / "o"
    )
    assert process.status == 2
    assert "there is no run 7" in process.said


def test_a_scheduled_run_writes_it_beside_its_report(stroked):
    """Of all its valves, also those that its report leaves out."""
    text = stroked.read_text("utf-8")
    stroked.write_text(f"[service]\nworkers = 1\nreport_valves = 1\n{text}", encoding="utf-8")
    plant = load_plant(stroked, environment={})
    with open_store(plant.storage) as store:
        number = store.queue.put(RunToQueue(who="Ann"), software_version="1")
        assert QueueWorker(store, plant).once(threading.Event())
        folder = Path(store.run(number).report)
        assert background_of(store, plant, number).run == number
    assert {path.name for path in folder.iterdir()} >= set(FILES)
    assert set(orders(folder / "work-orders.xlsx")) == {STICKY, BLIND}
    assert f"run {number}" in (folder / "maintenance.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("text", "full", "unit"),
    [("40 mm", 40.0, "mm"), ("4,5cm", 45.0, "mm"), ("1.5 in", 1.5, "in"), ("90 deg", 90.0, "°")],
)
def test_a_stroke_is_read_as_people_write_it(text, full, unit):
    """Lengths, and degrees of a rotary valve."""
    assert parse_stroke(text) == Stroke(full, unit)


def test_travel_is_said_in_the_strokes_own_unit():
    """With as many digits as anybody can read off a scale."""
    assert Stroke(40.0, "mm").of_percent(5.0) == "2.0 mm"
    assert Stroke(40.0, "mm").of_percent(0.5) == "0.20 mm"
    assert Stroke(90.0, "°").of_percent(5.0) == "4.5°"
    assert Stroke(1.5, "in").of_percent(5.0) == "0.075 in"


@pytest.mark.parametrize("text", ["40", "mm", "40 miles", "0 mm", "-3 mm", "", "4e1 mm"])
def test_a_stroke_that_is_none_is_refused_with_what_was_expected(plant, text):
    """The valve's line says so; its other keys are not at fault."""
    with pytest.raises(ValueError, match="the full stroke with its unit"):
        parse_stroke(text)
    written = plant.read_text("utf-8")
    marks = re.sub(rf'(id = "{STICKY}"\n)', rf'\1stroke = "{text}"\n', written)
    plant.write_text(marks, encoding="utf-8")
    try:
        problems = load_plant(plant, environment={}).problems
    except PlantFileError as error:
        problems = error.problems
    assert "stroke" in str(problems[0])
    assert "the full stroke with its unit" in str(problems[0])


FITS = """[...document.querySelectorAll('.sheet')].every(sheet => {
  const foot = sheet.getBoundingClientRect().bottom + 1;
  return sheet.scrollHeight <= sheet.clientHeight + 1 &&
    [...sheet.children].every(one => one.getBoundingClientRect().bottom <= foot);
})"""


@pytest.mark.long
@pytest.mark.browser
@pytest.mark.parametrize("make", ["mixed", "longest"])
def test_the_page_prints_one_sheet_per_valve(windows, tmp_path, make):
    """Also where every text is far too long; nothing is asked of any network, nothing is logged."""
    screenings = mixed()
    created, background = context(screenings), BACKGROUND
    if make == "longest":
        screenings, created, background = longest()
    files = write_maintenance(screenings, created, tmp_path, background)
    text: list[str] = []
    page = windows.open(
        files.html.as_uri(),
        logged=text,
        asked=text,
        viewport={"width": 695, "height": 1000},
        offline=True,
    )
    page.emulate_media(media="print")
    assert page.evaluate(FITS)
    printed = page.pdf(prefer_css_page_size=True)
    assert len(re.findall(rb"/Type\s*/Page\b(?!s)", printed)) == 1 + len(files.work_list.sheets)
    page.emulate_media(media="screen")
    page.set_viewport_size({"width": 390, "height": 800})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert text == [files.html.as_uri()]
