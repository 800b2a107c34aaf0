"""The page of the planned test in a browser: on a phone at the valve, by keyboard, on paper."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import timedelta
from urllib.parse import parse_qs, urlsplit

import pytest

from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.verdict import Verdict
from stemwatch.service.store.store import Store
from stemwatch.service.web.site import Site
from tests.service.example_mismatches import named
from tests.service.field_test.planned_tests import QUESTION
from tests.service.web.example_plant import HEALTHY, NOW, STICKY, screening, serving
from tests.service.web.pages.test_pages_browser import DESK, PHONE, Opened
from tests.service.web.signed_in import cookie_of

pytestmark = pytest.mark.browser

PATH = f"/valve/test-plan?id={STICKY}&minutes=2"


@pytest.fixture
def opened(windows, filled: Store) -> Iterator[Opened]:
    """The small plant, whose sticky valve leaves lag and dead time open."""
    run = filled.begin_run(software_version="1")
    mismatch = replace(
        named(), finding=Finding.CANDIDATES, open_question=QUESTION, p_value=0.001, runs=None
    )
    filled.save(screening(STICKY, at=NOW + timedelta(hours=1), mismatch=mismatch), run)
    site = Site(store=filled, clock=lambda: NOW)
    with serving(site) as base:
        site_opened = Opened(windows, base, cookie_of(site))
        yield site_opened
        site_opened.close()


# Each size and each theme has its turn in the short run.
SIZES_AND_THEMES = [
    pytest.param(PHONE, "dark", id="phone-dark"),
    pytest.param(DESK, "light", id="desk-light"),
    pytest.param(PHONE, "light", id="phone-light", marks=pytest.mark.long),
    pytest.param(DESK, "dark", id="desk-dark", marks=pytest.mark.long),
]


@pytest.mark.parametrize(("size", "theme"), SIZES_AND_THEMES)
def test_the_plan_fits_and_is_drawn(opened: Opened, size, theme) -> None:
    """Nothing runs out of the window, the picture has a name and is seen, nothing is logged or
    asked of another machine."""
    page = opened.page(PATH, viewport=size, color_scheme=theme)
    picture = page.locator(".test-plan svg[role=img]").first
    assert picture.is_visible()
    assert picture.get_attribute("aria-label")
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    assert "stemwatch never writes to a plant" in page.locator("main").inner_text()
    heights = picture.locator("text").evaluate_all(
        "all => all.map(one => one.getBoundingClientRect().height)"
    )
    assert min(heights) > 8  # pixels: letters can be read
    assert opened.errors == []
    assert opened.foreign == []


def test_limits_are_given_by_keyboard(opened: Opened) -> None:
    """Every field has a name that is spoken; Enter plans anew, and what was given stays in the
    field and in the address, so that the plan can be sent to somebody."""
    page = opened.page(PATH)
    fields = page.locator(".test-plan form input:not([type=hidden])")
    assert fields.count() == 6
    for field in fields.all():
        assert field.evaluate("one => one.labels.length && one.labels[0].innerText.trim()")
    page.get_by_label("Amplitude, % of OP").focus()
    page.keyboard.type("3,5")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.name") == "minutes"
    page.get_by_label("OP now, %").focus()
    page.keyboard.type("60")
    with page.expect_navigation():
        page.keyboard.press("Enter")
    assert parse_qs(urlsplit(page.url).query)["amplitude"] == ["3,5"]
    assert page.get_by_label("Amplitude, % of OP").input_value() == "3,5"
    assert "between 56.5 and 63.5\N{NO-BREAK SPACE}%" in page.locator("main").inner_text()


def test_a_limit_without_sense_is_said_where_the_form_is(opened: Opened) -> None:
    """As an alert that is read aloud; the fields keep what was given."""
    page = opened.page(f"/valve/test-plan?id={STICKY}&minutes=soon")
    assert "expected" in page.get_by_role("alert").inner_text()
    assert page.get_by_label("Minutes").input_value() == "soon"


@pytest.mark.long
def test_the_sheet_to_print_keeps_the_limits(opened: Opened) -> None:
    """The link leads to one page as PDF, with the limits of the page that it stands on."""
    page = opened.page(f"{PATH}&amplitude=4")
    link = page.get_by_role("link", name="One page to print (PDF)")
    address = link.get_attribute("href")
    assert address is not None
    query = parse_qs(urlsplit(address).query)
    assert (query["amplitude"], query["minutes"]) == (["4"], ["2"])
    answer = page.request.get(opened.base + address)
    assert answer.ok
    assert answer.body().startswith(b"%PDF")


@pytest.mark.long
def test_a_bump_test_fits_on_a_desk(opened: Opened, filled: Store) -> None:
    """The long names of its two stems wrap, so that the column for what was seen stays in sight."""
    run = filled.begin_run(software_version="1")
    unmoved = screening(HEALTHY, Verdict.UNDETERMINED, None, None, at=NOW + timedelta(hours=1))
    filled.save(unmoved, run)
    page = opened.page(f"/valve/test-plan?id={HEALTHY}&minutes=5", viewport=DESK)
    assert "MV: a stem that sticks, with S of 3 %" in page.locator("main").inner_text()
    seen = page.locator(".looks .seen").first.bounding_box()
    panel = page.locator(".test-plan .panel").first.bounding_box()
    assert seen["x"] + seen["width"] <= panel["x"] + panel["width"]
    assert page.evaluate("document.documentElement.scrollWidth") <= DESK["width"]
