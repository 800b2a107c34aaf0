"""The page in a real browser: drawn, sortable, printable, silent towards the network."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from stemwatch.models.recording import Role, Signal
from stemwatch.models.signals.position_histograms import position_histograms
from stemwatch.service.report import ValveFacts, html_page, write_report
from tests.service.browser_windows import colours_drawn

pytestmark = pytest.mark.browser


def tags(page) -> list[str]:
    return page.locator("#ranking-table tbody tr:visible .c-valve a").all_inner_texts()


@pytest.mark.long
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_plots_are_drawn_when_their_valve_comes_near(open_page, theme):
    """Far valves have no canvas; on scrolling there every plot of the valve has its lines."""
    page = open_page(color_scheme=theme)
    last = page.locator("article.with-plots").last
    assert last.locator("canvas").count() == 0
    last.scroll_into_view_if_needed()
    last.locator(".plot-loop canvas").wait_for()
    anchor = f'[id="{last.get_attribute("id")}"]'
    for name in ("travel", "process", "residual", "loop"):
        assert colours_drawn(page, f"{anchor} .plot-{name}") > 10
    assert page.locator("html").get_attribute("data-theme") == theme


def test_the_table_sorts_by_every_measure(open_page):
    """S sorts largest first with unknown values last, and back; aria-sort says which way."""
    page = open_page()
    head = page.locator("th.c-S[scope=col]")
    head.get_by_role("button").click()
    assert head.get_attribute("aria-sort") == "descending"
    result = page.locator("#ranking-table tbody td.c-S").evaluate_all(
        "cells => cells.map(cell => cell.dataset.sort)"
    )
    known = [float(text) for text in result if text]
    assert known == sorted(known, reverse=True)
    assert result[len(known) :] == [""] * (len(result) - len(known))
    assert page.locator("th[aria-sort]").count() == 1
    head.get_by_role("button").press("Enter")
    assert head.get_attribute("aria-sort") == "ascending"


def test_filters_hide_rows_and_sections(open_page):
    """Text, area and verdict filters work together, for the table and the valves below it."""
    page = open_page()
    everything = tags(page)
    page.fill("#find", "fv-10")
    page.select_option("#area", "Area 100")
    assert 0 < len(tags(page)) < len(everything)
    assert page.locator("article.valve:visible").count() == len(tags(page))
    for box in page.locator('input[name="verdict"]').all():
        box.uncheck()
    assert tags(page) == []
    assert page.get_by_text("No valve matches these filters.").is_visible()
    assert page.locator("#shown").inner_text() == f"0 of {len(everything)} valves"


def test_the_report_is_filtered_and_counted_by_unit(
    windows, make_screening, make_context, tmp_path
) -> None:
    """A choice of a unit leaves its rows and sections; *By unit* counts the work of each."""
    valves = [make_screening(f"FV-{n}", samples=50) for n in range(4)]
    facts = {
        valve.valve: ValveFacts(site="Harbour", area="Crude", unit=str(100 + 100 * (n % 2)))
        for n, valve in enumerate(valves)
    }
    files = write_report(valves, make_context(valves, valves=facts), tmp_path)
    page = windows.open(files.html.as_uri())
    page.select_option("#unit", "200")
    shown = page.locator("#ranking-table tbody tr:visible .c-valve a").all_inner_texts()
    assert sorted(shown) == ["FV-1", "FV-3"]
    assert page.locator("#site").count() == 0
    page.locator("details.units summary").click()
    rows = page.locator("details.units tbody tr").all_inner_texts()
    assert [row.split() for row in rows] == [
        ["Crude", "100", "2", "0", "0", "0"],
        ["Crude", "200", "2", "0", "0", "0"],
    ]
    contracts = json.loads(files.json.read_text("utf-8"))
    assert {one["valve"]: one["path"]["unit"] for one in contracts}["FV-3"] == "200"
    assert "unit" in files.csv.read_text("utf-8-sig").splitlines()[0].split(",")


def test_on_a_usual_screen_no_column_of_the_ranking_is_out_of_sight(
    windows, make_screening, make_context, tmp_path
) -> None:
    """With units, criticality and long names of areas as well."""
    valves = [make_screening(f"FIC-10{n}", samples=50) for n in range(3)]
    facts = ValveFacts(
        area="Crude distillation",
        unit="unit 100",
        criticality="2",
        description="Reflux to the atmospheric column",
    )
    context = make_context(valves, valves=dict.fromkeys((v.valve for v in valves), facts))
    files = write_report(valves, context, tmp_path)
    page = windows.open(files.html.as_uri(), viewport={"width": 1280, "height": 900})
    widths = page.locator("#ranking .sheet, #ranking-table").evaluate_all(
        "both => both.map(one => one.getBoundingClientRect().width)"
    )
    assert widths[1] <= widths[0]


def test_a_filter_counts_valves_that_have_a_row_alone(
    windows, make_screening, make_context, tmp_path, monkeypatch
) -> None:
    """Of a large plant the last valves have no section; they are filtered all the same."""
    monkeypatch.setattr(html_page, "MOST_SECTIONS", 3)
    valves = [make_screening(f"FV-{n}", samples=50) for n in range(6)]
    files = write_report(valves, make_context(valves), tmp_path)
    page = windows.open(files.html.as_uri())
    assert page.locator("article.valve").count() == 3
    rows = page.locator("#ranking-table tbody tr:visible")
    for tag in ("FV-0", "FV-5"):
        page.fill("#find", tag)
        assert rows.count() == 1
        assert page.locator("#shown").inner_text() == "1 of 6 valves"


@pytest.mark.parametrize("width", [1280, 390])
def test_histograms_are_bars_as_long_as_their_numbers(
    windows, make_screening, make_context, tmp_path, width: int
) -> None:
    """In each column the longest bar fills its place and the others are in proportion; the tables
    are within the page, beside each other at a desk and below each other on a phone."""
    valve = make_screening("FV-1")
    valve = replace(valve, histograms=position_histograms(valve.recording))
    files = write_report([valve], make_context([valve]), tmp_path)
    page = windows.open(files.html.as_uri(), viewport={"width": width, "height": 900})
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    classes, strokes = page.locator("table.histograms").all()
    classes.scroll_into_view_if_needed()
    assert classes.is_visible()
    assert strokes.is_visible()
    cells = classes.locator("tbody tr").evaluate_all(
        """rows => rows.map(row => [...row.querySelectorAll("td")].map(cell => [
            Number(cell.querySelector(".num").textContent.replace(",", "")),
            cell.querySelector(".length > span").getBoundingClientRect().width,
            cell.querySelector(".length").getBoundingClientRect().width,
        ]))"""
    )
    time, travel, turns = np.array(cells).transpose(1, 0, 2)
    for column, numbers in ((time, "time"), (travel, "travel"), (turns, "reversals")):
        expected = np.array(getattr(valve.histograms, numbers))
        assert column[:, 0] == pytest.approx(expected, rel=0.05, abs=0.05)
        shares = column[:, 1] / column[:, 2]
        assert shares == pytest.approx(expected / expected.max(), abs=0.06)
    beside = strokes.bounding_box()["y"] < classes.bounding_box()["y"] + 50.0
    assert beside == (width == 1280)
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_a_link_reaches_a_valve_that_a_filter_hides(open_page):
    """Following an anchor clears the filters rather than leading nowhere."""
    page = open_page()
    page.fill("#find", "FV-100")
    page.evaluate("location.hash = '#valve-LV-404'")
    page.locator('[id="valve-LV-404"]').wait_for(state="visible")
    assert page.input_value("#find") == ""


def test_odd_recordings_are_drawn_too(windows, make_screening, make_context, tmp_path):
    """No date, a flat OP, a gap for an MV and tags of 300 letters: drawn, and no wider a page."""
    screening = make_screening("V" * 300)
    undated = replace(screening, recording=replace(screening.recording, start=None))
    flat = Signal.good(np.full(3600, 41.0), "OP")
    removed = Signal.good(np.full(3600, np.nan), "MV")
    signals = {Role.OP: flat, Role.MV: removed}
    still = replace(
        screening, valve="flat", recording=replace(screening.recording, signals=signals)
    )
    valves = [undated, still]
    facts = {valve.valve: ValveFacts(area="A" * 300, criticality="C" * 300) for valve in valves}
    path = write_report(valves, make_context(valves, valves=facts), tmp_path).html
    errors: list[str] = []
    page = windows.open(path.as_uri(), logged=errors, viewport={"width": 390, "height": 800})
    for plots in page.locator("[data-plots]").all():
        plots.scroll_into_view_if_needed()
        plots.locator(".plot-loop canvas").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert errors == []


def test_the_theme_toggle_changes_page_and_plots(open_page):
    """The toggle turns the page dark and draws the plots again in its colours."""
    page = open_page(color_scheme="light")
    plots = page.locator("article.with-plots").first
    plots.scroll_into_view_if_needed()
    plots.locator(".plot-travel canvas").wait_for()
    light = page.evaluate("getComputedStyle(document.body).backgroundColor")
    drawn = plots.locator(".plot-travel canvas").evaluate("canvas => canvas.toDataURL()")
    page.get_by_role("button", name="Switch to the dark theme").click()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") != light
    page.wait_for_timeout(100)
    assert plots.locator(".plot-travel canvas").evaluate("canvas => canvas.toDataURL()") != drawn


def test_zooming_one_plot_zooms_all_of_the_valve(open_page):
    """A drag and the zoom buttons change every plot of the valve, the loop included."""
    page = open_page(viewport={"width": 1280, "height": 1100})
    plots = page.locator(".plots").first
    plots.scroll_into_view_if_needed()
    plots.locator(".plot-loop canvas").wait_for()
    names = ("travel", "process", "residual", "loop")

    def pictures():
        page.wait_for_timeout(150)
        read = "canvas => canvas.toDataURL()"
        return [plots.locator(f".plot-{name} canvas").evaluate(read) for name in names]

    drawings = pictures()
    box = plots.locator(".plot-travel .u-over").bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 260, box["y"] + 60, steps=4)
    page.mouse.up()
    dragged = pictures()
    assert [a == b for a, b in zip(drawings, dragged, strict=True)] == [False] * 4
    plots.get_by_role("button", name="Zoom in").click()
    assert [a == b for a, b in zip(dragged, pictures(), strict=True)] == [False] * 4


@pytest.mark.parametrize(
    "width", [320, *(pytest.param(width, marks=pytest.mark.long) for width in (390, 768))]
)
def test_a_phone_never_scrolls_sideways(open_page, width):
    """At phone width the page is as wide as the screen, details opened."""
    page = open_page(viewport={"width": width, "height": 800})
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_printing_draws_every_plot_in_light_colours(open_page):
    """Before printing all plots stand, in the light theme; afterwards the reader's is back."""
    page = open_page(color_scheme="dark")
    assert len(page.pdf(prefer_css_page_size=True, print_background=True)) > 50_000
    assert page.locator("html").get_attribute("data-theme") == "dark"
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.locator("html").get_attribute("data-theme") == "light"
    plotted = page.locator("[data-plots]").count()
    assert page.locator("[data-plots] .plot-travel canvas").count() == plotted
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")


def test_paper_says_at_its_head_what_the_foot_says(open_page):
    """The foot would take a sheet of its own where the last one is full."""
    page = open_page()
    assert page.locator(".printed").is_hidden()
    page.emulate_media(media="print")
    assert page.locator("footer").is_hidden()
    printed = page.locator(".printed").inner_text()
    assert page.locator("footer .facts code").first.text_content() in printed
    assert "all times in" in printed


def test_paper_has_the_ranking_as_a_table(open_page):
    """A sheet of A4 is as narrow as a phone, on which each valve becomes a card of its own."""
    page = open_page(viewport={"width": 700, "height": 990})
    shown = "getComputedStyle(document.querySelector('#ranking-table tbody')).display"
    assert page.evaluate(shown) == "block"
    page.emulate_media(media="print")
    assert page.evaluate(shown) == "table-row-group"
    columns = page.locator("#ranking-table tbody tr").first.locator("td:visible, th:visible")
    tops = columns.evaluate_all("cells => cells.map(cell => cell.getBoundingClientRect().top)")
    assert len(set(tops)) == 1
    assert page.evaluate("document.documentElement.scrollWidth") <= 700


def test_without_javascript_everything_but_the_plots_is_there(open_page):
    """Ranking and findings are readable, controls are gone, and a sentence says why."""
    page = open_page(java_script_enabled=False)
    assert len(tags(page)) == 14
    assert page.locator("article.valve .reason").first.is_visible()
    assert not page.locator("#filters").is_visible()
    assert page.locator("noscript p").is_visible()


def test_the_keyboard_reaches_the_ranking_first(open_page):
    """The first tab stop skips to the ranking; headings form one outline."""
    page = open_page()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the ranking"
    levels = page.locator("h1, h2, h3").evaluate_all("all => all.map(one => +one.tagName[1])")
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))
