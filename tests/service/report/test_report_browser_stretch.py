"""The first view of a valve in a real browser: its stretch, the strip and the lens on it."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.service.report.charts.traces import packed, unpacked

pytestmark = pytest.mark.browser


@pytest.fixture
def opened_plots(open_page):
    """The plots of the worst valve, drawn, in a desktop window."""
    page = open_page(viewport={"width": 1280, "height": 1300}, color_scheme="light")
    plots = page.locator(".plots").first
    plots.scroll_into_view_if_needed()
    plots.locator(".plot-loop canvas").wait_for()
    return plots


def shown(plots) -> str:
    return plots.locator(".view b").inner_text()


@pytest.mark.long
def test_plots_open_on_a_typical_stretch_that_says_where_it_is(opened_plots):
    """The first view names its times and why it was chosen; the strip's lens covers that part."""
    assert shown(opened_plots).startswith("A typical stretch: ")
    assert shown(opened_plots).replace("\N{NO-BREAK SPACE}", " ").endswith(" of 1 h")
    assert "Chosen as typical" in opened_plots.locator(".view").inner_text()
    lens = opened_plots.locator(".lens")
    strip = opened_plots.locator(".plot-overview .u-over").bounding_box()
    box = lens.bounding_box()
    chart = opened_plots.evaluate("box => stemwatchData.read(box.dataset.plots)")
    share = (chart["stretch"]["to"] - chart["stretch"]["from"]) / chart["duration"]
    assert box["width"] == pytest.approx(share * strip["width"], abs=2)
    left = chart["stretch"]["from"] / chart["duration"] * strip["width"]
    assert box["x"] - strip["x"] == pytest.approx(left, abs=2)
    assert lens.get_attribute("aria-valuetext") in shown(opened_plots)


def test_every_sample_of_the_stretch_reaches_the_plots(opened_plots):
    """Within the stretch points lie one interval apart, outside they are the thinned record's."""
    steps = opened_plots.evaluate(
        """box => {
            const chart = stemwatchData.read(box.dataset.plots), steps = {in: [], all: []};
            const from = chart.start + chart.stretch.from, to = chart.start + chart.stretch.to;
            chart.times.slice(1).forEach((at, k) => {
                steps.all.push(at - chart.times[k]);
                if (chart.times[k] >= from && at <= to) steps.in.push(at - chart.times[k]);
            });
            const odd = chart.panels.flatMap(panel => panel.series)
                .filter(series => series.values.length !== chart.times.length);
            return {inside: steps.in, smallest: Math.min(...steps.all), odd: odd.length};
        }"""
    )
    assert len(steps["inside"]) > 100
    assert set(steps["inside"]) == {1}
    assert steps["smallest"] > 0
    assert steps["odd"] == 0


def test_the_whole_record_and_the_stretch_are_one_button_apart(opened_plots):
    """The pressed button is the view one has, and no button is pressed in between."""
    first = shown(opened_plots)
    by_role = opened_plots.get_by_role("button", name="Whole record")
    typical = opened_plots.get_by_role("button", name="Typical stretch")
    assert typical.get_attribute("aria-pressed") == "true"
    by_role.click()
    assert shown(opened_plots) == "The whole record: 07:00:00 to 08:00:00"
    assert by_role.get_attribute("aria-pressed") == "true"
    assert not opened_plots.locator(".view span").is_visible()
    opened_plots.get_by_role("button", name="Zoom in").click()
    assert shown(opened_plots).startswith("Shown: 07:15:00 to 07:45:00")
    assert opened_plots.locator("[aria-pressed=true]").count() == 0
    typical.click()
    assert shown(opened_plots) == first


def test_the_lens_moves_by_mouse_and_by_key(opened_plots):
    """A drag shifts the window by as much time, keys step it, and it stops at the ends."""
    page, lens = opened_plots.page, opened_plots.locator(".lens")
    picture = "canvas => canvas.toDataURL()"
    before = opened_plots.locator(".plot-loop canvas").evaluate(picture)
    box = lens.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 15)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2 - 60, box["y"] + 15, steps=4)
    page.mouse.up()
    moved = lens.bounding_box()
    assert moved["x"] - box["x"] == pytest.approx(-60, abs=2)
    assert moved["width"] == pytest.approx(box["width"], abs=1)
    assert shown(opened_plots).startswith("Shown: ")
    page.wait_for_timeout(150)
    assert opened_plots.locator(".plot-loop canvas").evaluate(picture) != before
    lens.press("ArrowRight")
    assert lens.bounding_box()["x"] > moved["x"]
    lens.press("Home")
    assert shown(opened_plots).startswith("Shown: 07:00:00 to ")
    assert lens.get_attribute("aria-valuenow") == "0"
    lens.press("ArrowLeft")
    assert shown(opened_plots).startswith("Shown: 07:00:00 to ")
    lens.press("End")
    assert " to 08:00:00 of" in shown(opened_plots)
    assert lens.get_attribute("aria-valuenow") == "100"


def test_a_click_on_the_strip_goes_there(opened_plots):
    """The window is centred where one pressed."""
    opened_plots.get_by_role("button", name="Zoom in").click()
    strip, lens = opened_plots.locator(".plot-overview .u-over"), opened_plots.locator(".lens")
    box, before = strip.bounding_box(), lens.bounding_box()
    to_the_right = before["x"] - box["x"] < box["width"] / 2
    place = box["width"] * (0.75 if to_the_right else 0.25)
    strip.click(position={"x": place, "y": 10}, force=True)
    after = lens.bounding_box()
    assert after["x"] + after["width"] / 2 - box["x"] == pytest.approx(place, abs=3)


def test_paper_shows_the_stretch_of_every_valve(open_page):
    """Valves nobody scrolled to are printed on their stretch, not as a filled band."""
    page = open_page()
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    with_stretch = page.locator(".plots:has([data-zoom=typical]) .view b")
    text = with_stretch.all_text_contents()
    assert len(text) > 5
    assert {item.split(":")[0] for item in text} == {"A typical stretch"}
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")


@pytest.mark.long
def test_the_script_reads_what_was_packed(opened_plots):
    """Letters become the same numbers in the page as in Python, with the gaps where they were."""
    values = np.array([61.25, np.nan, np.nan, -1e6, 1e6, 1e6, np.nan])
    read = opened_plots.evaluate(
        """(box, packed) => {
            const holder = document.createElement("script");
            Object.assign(holder, {type: "application/json", id: "packed"});
            holder.textContent = JSON.stringify({
                start: 0, first: 0, step: 1, interval: 1, duration: 7, detail: null, loop: null,
                panels: [{series: [{role: "op", values: packed}]}],
            });
            box.append(holder);
            const values = stemwatchData.read("packed").panels[0].series[0].values;
            holder.remove();
            return values;
        }""",
        packed(values),
    )
    expected = unpacked(packed(values))
    np.testing.assert_array_equal(np.array(read, dtype=np.float64), expected)
