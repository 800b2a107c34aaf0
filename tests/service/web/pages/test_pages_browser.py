"""The pages in a real browser: drawn, quick to the hand, silent towards the network."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import timedelta
from itertools import pairwise
from urllib.parse import parse_qs, urlsplit

import pytest

from stemwatch.service.store.accounts.records import UserRole
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.web.site import Site
from tests.service.browser_windows import Windows, colours_drawn
from tests.service.open_alerts import open_alerts
from tests.service.web.example_plant import HOSTILE, NOW, STICKY, plant_of, screening, serving
from tests.service.web.signed_in import NAMES, cookie_of

pytestmark = pytest.mark.browser

PHONE = {"width": 390, "height": 800}
DESK = {"width": 1280, "height": 1000}


class Opened:
    """A browser at one site. It remembers what was logged and what was asked of other machines."""

    def __init__(self, windows: Windows, base: str, cookies: dict[str, str] | None = None) -> None:
        self.base = base
        self.errors: list[str] = []
        self._windows = windows
        self._asked: list[str] = []
        self._cookies = [
            {"name": name, "value": value, "url": base} for name, value in (cookies or {}).items()
        ]

    def page(self, path: str, **options):
        """A page of the site, in a window of its own."""
        return self._windows.open(
            self.base + path,
            cookies=self._cookies,
            logged=self.errors,
            asked=self._asked,
            **{"viewport": DESK, **options},
        )

    @property
    def foreign(self) -> list[str]:
        """What was asked of other machines."""
        return [url for url in self._asked if not url.startswith((self.base, "data:"))]

    def close(self) -> None:
        """Close every window."""
        self._windows.close()


@pytest.fixture
def opened(windows, live) -> Iterator[Opened]:
    """The small plant; at the end nothing was logged, which a breach of the policy would be, and
    nothing was asked of another machine."""
    with serving(live) as base:
        at = Opened(windows, base, cookie_of(live))
        yield at
        at.close()
    assert at.errors == []
    assert at.foreign == []


def valve_path(valve: str) -> str:
    """Where a valve's page is."""
    from stemwatch.service.web.page_renderer import valve_link

    return valve_link(valve)


def drawn(page):
    """The page once its plots stand."""
    for name in ("travel", "loop", "S", "J"):
        page.locator(f".plot-{name} canvas").wait_for()
    return page


# Each size and each theme has its turn in the short run.
SIZES_AND_THEMES = [
    pytest.param(PHONE, "dark", id="phone-dark"),
    pytest.param(DESK, "light", id="desk-light"),
    pytest.param(PHONE, "light", id="phone-light", marks=pytest.mark.long),
    pytest.param(DESK, "dark", id="desk-dark", marks=pytest.mark.long),
]


@pytest.mark.parametrize(("size", "theme"), SIZES_AND_THEMES)
def test_a_valves_plots_are_drawn(opened, theme, size):
    """Signals, loop and months have their lines, on a phone and in the dark as well."""
    page = drawn(opened.page(valve_path(STICKY), color_scheme=theme, viewport=size))
    for name in ("travel", "loop", "S", "J"):
        assert colours_drawn(page, f".plot-{name}") > 8
    assert page.locator("html").get_attribute("data-theme") == theme
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    assert "2026-03-30" in page.locator(".view b").inner_text()


@pytest.mark.parametrize("path", ["/", "/alerts", "/runs", "/sources", "/settings", "/api/docs"])
def test_a_phone_never_scrolls_sideways(opened, path):
    """Every page is as wide as the screen, with everything unfolded and a name of 27 signs."""
    page = opened.page(path, viewport=PHONE)
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]


def test_a_phone_reads_the_runs_without_scrolling_their_table(opened, live):
    """Each run is a card there: what stood in a column says what it is, however long a reason."""
    number = live.store.begin_run(software_version="0.1")
    live.store.queue.finish(number, RunState.FAILED, reason="no answer from " + 20 * "historian")
    page = opened.page("/runs", viewport=PHONE)
    table = page.locator(".folding")
    heads = table.locator("thead th").all_text_contents()
    assert table.evaluate("one => one.scrollWidth <= one.parentNode.clientWidth")
    assert "historianhistorian" in table.locator("tbody tr").first.inner_text()
    cells = table.locator("tbody tr").nth(1).locator("th, td")
    assert all(cell.is_visible() for cell in cells.all())
    text = "all => all.map(one => getComputedStyle(one, '::before').content)"
    assert cells.evaluate_all(text) == [f'"{head}"' for head in heads]
    page.set_viewport_size(DESK)
    assert set(cells.evaluate_all(text)) == {"none"}


def test_zooming_asks_for_more_and_stands_in_the_address(opened):
    """A drag shows that part in more detail; the address leads a colleague to the same part."""
    page = drawn(opened.page(valve_path(STICKY)))
    box = page.locator(".plot-travel .u-over").bounding_box()
    before = page.locator(".view b").inner_text()
    with page.expect_response("**/signals?*") as requested:
        page.mouse.move(box["x"] + 100, box["y"] + 60)
        page.mouse.down()
        page.mouse.move(box["x"] + 200, box["y"] + 60, steps=4)
        page.mouse.up()
    assert requested.value.json()["bucket_s"] == 0.0
    changed = "before => document.querySelector('.view b').textContent !== before"
    page.wait_for_function(changed, arg=before)
    fields = parse_qs(urlsplit(page.url).query)
    first, last = float(fields["from"][0]), float(fields["to"][0])
    assert 0 < last - first < 3600
    assert fields["id"] == [STICKY]
    repeated = drawn(opened.page(page.url.removeprefix(opened.base)))
    assert repeated.locator(".view b").inner_text() == page.locator(".view b").inner_text()


def test_the_keyboard_alone_moves_and_zooms_the_plots(opened):
    """Arrow keys and plus and minus work where the plots have the focus."""
    page = drawn(opened.page(valve_path(STICKY)))
    page.locator(".live-plots .over-time").focus()
    for key in ("+", "ArrowLeft", "ArrowRight", "-"):
        with page.expect_response("**/signals?*"):
            page.keyboard.press(key)
    with page.expect_response("**/signals?*"):
        page.get_by_role("button", name="1 h", exact=True).press("Enter")
    by_role = page.get_by_role("button", name="1 h", exact=True)
    assert by_role.get_attribute("aria-pressed") == "true"


def test_the_theme_toggle_draws_the_plots_again(opened):
    """Page and plots change together, and the choice holds on the next page."""
    page = drawn(opened.page(valve_path(STICKY), color_scheme="light"))
    read = "canvas => canvas.toDataURL()"
    before = page.locator(".plot-travel canvas").evaluate(read)
    page.get_by_role("button", name="Switch to the dark theme").click()
    assert page.locator(".plot-travel canvas").evaluate(read) != before
    page.get_by_role("link", name="All valves").click()
    assert page.locator("html").get_attribute("data-theme") == "dark"


def test_filters_act_at_once_and_stand_in_the_address(opened):
    """Ticking a verdict narrows the ranking, the address keeps it, and back undoes it."""
    page = opened.page("/")
    assert page.locator("#ranking-table tbody tr").count() == 5
    page.locator('input[value="sticky"]').check()
    page.wait_for_url("**verdict=sticky*")
    assert page.locator(".c-valve > a:first-child").all_inner_texts() == [STICKY]
    assert "q=" not in page.url
    page.go_back()
    page.wait_for_function("document.querySelectorAll('#ranking-table tbody tr').length === 5")
    page.locator("#ranking-table th a", has_text="S, %").click()
    page.wait_for_url("**sort=S*")
    assert page.locator("th.h-S").get_attribute("aria-sort") == "descending"


def test_an_alert_is_acknowledged_from_the_valves_page(opened, live):
    """A comment and a click: the count in the head goes down, the signed-in name stands there."""
    page = opened.page(valve_path(STICKY) + "#alerts")
    assert page.locator("nav .badge").first.inner_text().startswith("2")
    card = page.locator(".card").first
    card.locator("summary").click()
    card.locator('input[name="text"]').fill("packing is ordered")
    card.get_by_role("button", name="Acknowledge").click()
    page.get_by_text("The alert is acknowledged.").wait_for()
    assert page.locator("nav .badge").first.inner_text().startswith("1")
    assert "packing is ordered" in page.locator(".card").first.inner_text()
    assert open_alerts(live.store, STICKY)[0].acknowledged_by == NAMES[UserRole.ADMIN]


def test_a_name_that_is_a_script_stays_a_name(opened):
    """It is shown letter by letter, its page opens by its link, and nothing of it runs."""
    page = opened.page("/")
    page.locator(".c-valve a", has_text="<script>").first.click()
    assert page.locator("h1").inner_text() == HOSTILE
    page.locator(".view span").filter(has_text="plant file").wait_for()
    assert page.locator("article img, article script").count() == 0


def test_runs_refresh_by_themselves(opened, live):
    """A run that begins while somebody looks appears without a reload."""
    from stemwatch.service.store.runs.queue import RunToQueue

    page = opened.page("/runs")
    assert "No run is waiting" in page.locator("#going").inner_text()
    live.store.queue.put(RunToQueue(who="K. Berg"), software_version="0.1")
    page.locator("#going .card").wait_for(timeout=15_000)


def test_a_finished_run_appears_on_the_valves_page(opened, live):
    """Finding, numbers and months are the new window's without a reload; a note that somebody is
    writing stays, and what was unfolded too."""
    from stemwatch.service.store.runs.queue import RunToQueue

    page = drawn(opened.page(valve_path(STICKY)))
    with page.expect_response("**/api/v1/changes"):
        page.evaluate("window.stayed = true")
    page.locator("summary", has_text="Add a note").click()
    page.locator("#valve-log details[open] [name=text]").fill("heard it squeak")
    page.locator(".history summary").click()
    number = live.store.queue.put(RunToQueue(who="K. Berg"), software_version="0.1")
    new = screening(STICKY, S=3.21, at=NOW + timedelta(hours=1), reason="It let go late.")
    live.store.save(new, number)
    live.store.queue.finish(number, RunState.DONE)
    with page.expect_response("**/api/v1/valve/history*", timeout=60_000):
        page.locator(".reason", has_text="It let go late.").wait_for(timeout=60_000)
    assert page.evaluate("window.stayed")
    assert "3.21" in page.locator(".gauges").first.inner_text()
    assert page.locator(".history tbody tr").count() == 7
    assert page.locator(".history").evaluate("one => one.open")
    assert page.locator("#valve-log details[open] [name=text]").input_value() == "heard it squeak"


def test_without_javascript_everything_but_the_plots_is_there(opened):
    """Filters have a button, forms work, months stand in a table, and a sentence says why."""
    page = opened.page(valve_path(STICKY), java_script_enabled=False)
    assert page.locator(".reason").is_visible()
    assert page.locator("noscript p").is_visible()
    page.locator(".history summary").click()
    assert page.locator(".history tbody tr").count() == 6
    page.goto(opened.base + "/")
    page.fill('input[name="q"]', "fic")
    page.get_by_role("button", name="Show").click()
    # A page that is still arriving has fewer rows.
    page.wait_for_url("**/?q=fic*")
    assert page.locator("#ranking-table tbody tr").count() == 2


def test_the_keyboard_reaches_the_content_first(opened):
    """The first tab stop skips the head; headings form one outline on every page."""
    page = opened.page("/")
    for path in ("/", valve_path(STICKY), "/alerts", "/runs", "/sources", "/settings"):
        page.goto(opened.base + path)
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
        levels = page.locator("h1, h2, h3, h4").evaluate_all(
            "all => all.map(one => +one.tagName[1])"
        )
        assert levels.count(1) == 1
        assert all(after <= before + 1 for before, after in pairwise(levels))


def test_an_empty_database_is_no_empty_page(windows, store, tmp_path):
    """The first start says what to do, and the page of a valve without data is whole."""
    site = Site(store=store, plant=plant_of(tmp_path, store), clock=lambda: NOW)
    with serving(site) as base:
        at = Opened(windows, base, cookie_of(site))
        assert at.page("/").get_by_text("No valve is known yet").is_visible()
        page = at.page(valve_path(STICKY))
        page.locator(".view span").filter(has_text="stemwatch serve").wait_for()
        at.close()
    assert at.errors == []
    assert at.foreign == []


@pytest.mark.long
def test_a_page_stays_when_the_service_goes(opened):
    """With the network cut, what was drawn stays and a sentence says that it may be old."""
    page = drawn(opened.page(valve_path(STICKY)))
    page.context.set_offline(True)
    page.get_by_role("button", name="Earlier").click()
    page.locator(".view span").filter(has_text="does not answer").wait_for()
    assert colours_drawn(page, ".plot-travel") > 8
    opened.errors[:] = [
        error for error in opened.errors if "ERR_INTERNET_DISCONNECTED" not in error
    ]


@pytest.mark.parametrize("path", ["/overview", "/", "/alerts", "/settings", valve_path(STICKY)])
def test_paper_has_no_buttons_nothing_cut_off_and_no_sheet_for_the_foot(opened, path):
    """On A4 each page is as wide as the sheet, and says at its head when it was printed."""
    page = opened.page(path, viewport=DESK)
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 700, "height": 990})
    assert page.locator("button:visible, footer:visible, nav:visible").count() == 0
    assert "all times in Europe/Berlin" in page.locator(".printed").inner_text()
    reach = "all => Math.max(...all.map(one => one.scrollWidth - one.clientWidth))"
    assert page.locator("html, .sheet:visible").evaluate_all(reach) <= 0


def test_at_a_desk_the_head_is_one_line(opened, live):
    """However long the names of plant and person, no button goes to a second line, and the plant's
    is not cut."""
    page = opened.page("/overview", viewport={"width": 1280, "height": 800})
    page.evaluate(
        """() => {
            document.querySelector(".plant").textContent = "Refinery of a long name, unit 100";
            document.querySelector(".whoami a bdi").textContent = "A. B. von und zu Beispielhausen";
        }"""
    )
    lines = page.locator(".brand, .top nav, .whoami, .tools").evaluate_all(
        "all => all.map(one => one.getBoundingClientRect()).map(box => (box.top + box.bottom) / 2)"
    )
    assert max(lines) - min(lines) < 4
    room = page.locator(".brand .plant").evaluate(
        "one => [one.scrollWidth - one.clientWidth, one.scrollHeight - one.clientHeight]"
    )
    assert max(room) <= 0
    assert page.locator(".brand .plant").evaluate("one => getComputedStyle(one).display") == "block"
    assert page.evaluate("document.documentElement.scrollWidth") <= 1280


@pytest.mark.long
def test_a_valves_plots_are_drawn_anew_for_paper(opened):
    """As wide as the sheet and in ink, whatever the window and theme; afterwards as before."""
    page = drawn(opened.page(valve_path(STICKY), color_scheme="dark", viewport=DESK))
    wide = "document.querySelector('.plot-S .uplot').getBoundingClientRect().width"
    before = page.evaluate(wide)
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.locator("html").get_attribute("data-theme") == "light"
    assert page.evaluate(wide) < 700 < before
    page.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert page.locator("html").get_attribute("data-theme") == "dark"
    assert page.evaluate(wide) == before
