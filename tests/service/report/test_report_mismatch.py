"""What S and J leave out, in the report: page, JSON, CSV and workbook."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from importlib.resources import files
from xml.etree import ElementTree

import jsonschema
import numpy as np
import openpyxl
import pytest

from stemwatch.models.history.evidence_over_windows import WindowEvidence
from stemwatch.models.mismatch.findings import FreeRuns, HotPlace, ResidualMap
from stemwatch.service.explain.explain_recording import Explained
from stemwatch.service.explain.write_explanation import write_pages
from stemwatch.service.presenter.evidence_of_weeks import evidence_of_weeks
from stemwatch.service.report import write_report
from stemwatch.service.report.charts.valve_charts import overlay_of
from stemwatch.service.report.heatmap import heat_map, largest
from stemwatch.service.report.mismatch_view import facet_bars
from tests.service.example_mismatches import effect, named, of_every_kind, residual_map

SCHEMA = json.loads(
    files("stemwatch.service.report").joinpath("contract.schema.json").read_text("utf-8")
)
HOSTILE = "</script><img src=x onerror=alert(1)>\x00=1+1"


@pytest.fixture
def explained_plant(make_screening):
    """One valve of every verdict, and one of which nothing was asked."""
    screening = make_screening("FV-9", samples=900)
    matching = [
        replace(make_screening(f"FV-{k}", seed=k, samples=900), mismatch=item)
        for k, item in enumerate(of_every_kind(screening.recording))
    ]
    return [*matching, screening]


@pytest.fixture
def written(explained_plant, make_context, tmp_path):
    return write_report(explained_plant, make_context(explained_plant), tmp_path)


def rows_by_valve(path):
    with path.open(encoding="utf-8-sig", newline="") as file:
        return {row["valve"]: row for row in csv.DictReader(file)}


def test_the_contract_holds_it(written):
    """The objects follow the schema; a valve without a fit has null."""
    objects = {load["valve"]: load for load in json.loads(written.json.read_text("utf-8"))}
    jsonschema.validate(list(objects.values()), SCHEMA)
    assert objects["FV-9"]["mismatch"] is None
    assert objects["FV-0"]["mismatch"]["effects"][0]["slug"] == "asymmetric_rate_limit"
    assert objects["FV-0"]["mismatch"]["stroke_curve"] is None
    curve = objects["FV-1"]["mismatch"]["stroke_curve"]
    assert curve["op_percent"] == [50.0, 75.0, 100.0]
    assert curve["slope"] == 2.0
    assert "OP 50 to 100 %" in curve["sentence"]


def test_csv_and_workbook_have_its_columns(written):
    """Verdict, what was left out with its class, and the fit before and after."""
    row = rows_by_valve(written.csv)["FV-0"]
    assert row["mismatch"] == "named"
    assert row["left out"] == "asymmetric_rate_limit, dead_time|actuator_lag"
    assert float(row["fit of S and J (%)"]) == 24.2
    assert float(row["fit with what was left out (%)"]) == 69.4
    assert rows_by_valve(written.csv)["FV-9"]["mismatch"] == ""
    head, *rows = openpyxl.load_workbook(written.xlsx)["Ranking"].iter_rows(values_only=True)
    cells = {row[head.index("valve")]: row[head.index("left out")] for row in rows}
    assert cells["FV-0"] == "asymmetric_rate_limit, dead_time|actuator_lag"
    assert cells["FV-9"] is None


def test_the_page_shows_it_where_there_is_one(written):
    """Five sections, one for each valve that has a mismatch, each with its sentence."""
    page = written.html.read_text("utf-8")
    assert page.count('<section class="mismatch') == 5
    section = page.split('id="valve-FV-0-mismatch"')[1].split("</section>")[0]
    assert "The actuator closes at no more than" in section
    assert "<h4>asymmetric rate limit</h4>" in section
    assert "actuator lag" in section
    assert section.count('<svg class="map') == 2
    assert section.count('<svg class="small-plot"') >= 4
    assert "11.8 %" in section
    assert "69.4 %" in section
    assert 'id="valve-FV-9-mismatch"' not in page


def test_a_valve_with_nothing_left_out_gets_one_sentence(written):
    """No map, no overlay, no table."""
    page = written.html.read_text("utf-8")
    section = page.split('id="valve-FV-3-mismatch"')[1].split("</section>")[0]
    assert "S and J explain the recording." in section
    assert "<svg" not in section
    assert "data-plots" not in section


def test_hostile_words_are_text(make_screening, make_context, tmp_path):
    """Whatever an effect, a place or a phase is called, it is no markup and no formula."""
    hot_place = HotPlace(facet=HOSTILE, label=HOSTILE, share=0.5, z=5.0, sentence=HOSTILE)
    bad_map = replace(
        residual_map(1.0, hot=True), columns=(HOSTILE,) * 5, hot=(hot_place,), cells=()
    )
    bad = replace(effect(), slug=HOSTILE, members=(HOSTILE,), sentence=HOSTILE, where=HOSTILE)
    valve = make_screening("FV-1", samples=300)
    changed = replace(named(valve.recording), sentence=HOSTILE, effects=(bad,), before=bad_map)
    valves = [replace(valve, mismatch=changed)]
    paths = write_report(valves, make_context(valves), tmp_path)
    page = paths.html.read_text("utf-8")
    assert "<img" not in page
    assert "\x00" not in page
    sheet = openpyxl.load_workbook(paths.xlsx)["Ranking"]
    assert {cell.data_type for row in sheet.iter_rows() for cell in row} <= {"s", "n", "d"}


def test_the_map_shows_every_cell_on_a_common_scale():
    """Numbers in the cells, an empty one without, the highest travel on top, valid XML."""
    before, after = residual_map(1.6, hot=True), residual_map(0.4, hot=False)
    top = largest(before, after)
    picture = heat_map(before, top, "before", alone=True)
    root = ElementTree.fromstring(str(picture))
    space = "{http://www.w3.org/2000/svg}"
    kinds = [item.get("class") for item in root.iter(f"{space}rect")]
    assert (kinds.count("heat"), kinds.count("none")) == (19, 1)
    dark = [
        float(item.get("fill-opacity"))
        for item in root.iter(f"{space}rect")
        if len(item.keys()) > 6
    ]
    assert max(dark) == 0.5
    labels = [item.text for item in root.iter(f"{space}text") if item.get("text-anchor") == "end"]
    assert labels[0] == "30–38 %"
    heights = [
        float(item.get("y"))
        for item in root.iter(f"{space}text")
        if item.get("text-anchor") == "end"
    ]
    assert heights == sorted(heights, reverse=True)
    quiet = re.findall(r'fill-opacity="([\d.]+)"', str(heat_map(after, top, "after")))
    assert max(float(item) for item in quiet) < 0.2


def test_a_map_without_cells_is_no_picture():
    """An engine that located nothing leaves no empty frame."""
    assert heat_map(ResidualMap(), 1.0, "before") is None
    assert largest(ResidualMap()) == 0.0


def test_bars_pair_each_place_before_and_after():
    """Lengths are of one scale, and a place that is hot is marked."""
    phase, direction = facet_bars(named())
    assert phase.title == "By phase of the motion"
    longest = max(index.before_length for item in (phase, direction) for index in item.places)
    assert longest == 100.0
    falling = direction.places[0]
    assert falling.hot
    assert falling.after == pytest.approx(falling.before / 4)
    assert falling.after_length == pytest.approx(falling.before_length / 4, abs=0.1)


def test_the_overlay_draws_recording_and_both_simulations(make_screening):
    """Two panels: the traces over one another, and what each leaves unexplained."""
    recording = make_screening("FV-1", samples=900).recording
    chart = overlay_of(recording, named(recording).runs)
    roles = [[item["role"] for item in panel["series"]] for panel in chart["panels"]]
    assert roles == [["op", "mv", "naive", "extended"], ["naive", "extended"]]
    assert chart["heldout"] == 540.0


def test_a_run_that_changed_nothing_is_drawn_once(make_screening):
    """Where nothing was named, the extended model is the naive one and no second line."""
    recording = make_screening("FV-1", samples=900).recording
    naive = named(recording).runs.naive
    chart = overlay_of(recording, FreeRuns(naive=naive, extended=naive.copy(), heldout_from=540))
    assert [item["role"] for item in chart["panels"][1]["series"]] == ["naive"]


def test_a_run_of_another_length_is_refused(make_screening):
    """The message names the tag and both lengths."""
    recording = make_screening("FV-1", samples=900).recording
    short = FreeRuns(naive=np.zeros(10), extended=np.ones(10), heldout_from=5)
    with pytest.raises(ValueError, match=r"FV-1.MV: .*expected \(900,\), received \(10,\)"):
        overlay_of(recording, short)


@pytest.fixture
def explained_page(make_screening, make_context, tmp_path):
    """The page of ``stemwatch explain`` for one valve of every verdict."""
    read = make_screening("FV-1", samples=900).recording
    matching = [
        Explained(source=f"FV-{k}.csv", valve=f"FV-{k}", mismatch=item, recording=read)
        for k, item in enumerate(of_every_kind(read))
    ]
    return write_pages(matching, make_context([]), tmp_path / "explained").html


@pytest.mark.browser
@pytest.mark.parametrize(
    ("which", "theme"),
    [
        ("report", "light"),
        ("explain", "dark"),
        pytest.param("report", "dark", marks=pytest.mark.long),
        pytest.param("explain", "light", marks=pytest.mark.long),
    ],
)
def test_the_section_is_drawn_in_a_browser(windows, written, explained_page, theme, which):
    """Overlay and maps stand, on a phone too, without an error and no wider than the screen."""
    path = {"report": written.html, "explain": explained_page}[which]
    errors: list[str] = []
    page = windows.open(
        path.as_uri(),
        logged=errors,
        viewport={"width": 390, "height": 800},
        color_scheme=theme,
        offline=True,
    )
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    overlay = page.locator(".overlay").first
    # As a reader comes there: by the valve, which is laid out in full once it is on the screen.
    overlay.evaluate("one => one.closest('article')?.scrollIntoView()")
    page.evaluate("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
    overlay.scroll_into_view_if_needed()
    overlay.locator(".plot-residual canvas").wait_for()
    assert overlay.locator(".plot-travel .u-legend .u-series").count() == 5
    assert page.locator("svg.map").first.is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert errors == []


@pytest.mark.browser
def test_the_explained_page_zooms_and_prints(windows, explained_page):
    """The buttons change the view that is told, and printing draws every overlay."""
    page = windows.open(explained_page.as_uri())
    overlay = page.locator(".overlay").first
    overlay.scroll_into_view_if_needed()
    overlay.locator(".plot-residual canvas").wait_for()
    overlay.get_by_role("button", name="Whole record").click()
    complete = overlay.locator(".view b").inner_text()
    overlay.get_by_role("button", name="Zoom in").click()
    assert overlay.locator(".view b").inner_text() != complete
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    plotted = page.locator("[data-plots]").count()
    assert page.locator("[data-plots] .plot-travel canvas").count() == plotted == 4


@pytest.mark.browser
def test_without_scripts_the_findings_and_maps_are_there(windows, explained_page):
    """Only the plots need scripts, and a sentence says so."""
    page = windows.open(explained_page.as_uri(), java_script_enabled=False)
    assert page.locator(".effect").first.is_visible()
    assert page.locator("svg.map").first.is_visible()
    assert page.locator("noscript p").is_visible()
    assert not page.locator(".overlay").first.is_visible()


@pytest.mark.long
def test_the_report_says_what_windows_of_weeks_confirm(explained_plant, make_context, tmp_path):
    """In the valve's section, with the picture; a valve without has none."""
    first = datetime(2026, 3, 1, 6, tzinfo=UTC)
    windows = [
        WindowEvidence(at=first + timedelta(days=day), named=(("flow_force",),)) for day in range(3)
    ]
    context = make_context(explained_plant)
    facts = replace(context.facts("FV-0"), by_window=evidence_of_weeks(windows))
    context = replace(context, valves={**context.valves, "FV-0": facts})
    files = write_report(explained_plant, context, tmp_path)
    objects = json.loads(files.json.read_text("utf-8"))
    jsonschema.validate(objects, SCHEMA)
    (finding,) = next(object["over_weeks"] for object in objects if object["valve"] == "FV-0")
    assert (finding["state"], finding["named"], finding["of"]) == ("standing", 3, 3)
    page = files.html.read_text("utf-8")
    assert page.count("Over the windows of the last weeks") == 1
    assert "Flow force: first seen on 2026-03-01, confirmed in 3 of 3 windows." in page
    assert page.count('<svg class="by-window"') == 1
