"""A valve's page with everything on it: short on a phone, open at a desk, whole on paper."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import pytest

from stemwatch.models.mismatch.findings import Untestable
from stemwatch.models.mismatch.identifiability import PHYSICS
from stemwatch.service.web.site import Site
from tests.service.example_mismatches import named
from tests.service.web import example_plant
from tests.service.web.signed_in import cookie_of

pytestmark = pytest.mark.browser
# Half of what it was when all of it stood open below each other.
MOST_PIXELS = 6350
WHY = "the stem slipped 0 times rising and 0 times falling; sizes are compared from 3 each way"


@pytest.fixture
def full(live: Site) -> Site:
    """The sticky valve with two effects, twelve that could not be shown, and thirteen rejected."""
    mismatch = named()
    other = mismatch.tried[-1]
    mismatch = replace(
        mismatch,
        tried=(*mismatch.tried[:2], *(replace(other, slug=slug) for slug in PHYSICS[:13])),
        not_testable=tuple(Untestable(slug=slug, reason=WHY) for slug in PHYSICS[:12]),
    )
    run = live.store.begin_run(command="test", software_version="test", settings_digest="")
    at = example_plant.NOW + timedelta(minutes=1)
    live.store.save(example_plant.screening(example_plant.STICKY, at=at, mismatch=mismatch), run)
    return live


@pytest.fixture
def opened(full: Site, browser):
    """Opens the valve's page in a window of this width."""
    contexts = []
    with example_plant.serving(full) as base:

        def at(width: int):
            context = browser.new_context(viewport={"width": width, "height": 850})
            contexts.append(context)
            (name, value) = next(iter(cookie_of(full).items()))
            context.add_cookies([{"name": name, "value": value, "url": base}])
            page = context.new_page()
            page.goto(f"{base}/valve?id={example_plant.STICKY}")
            page.locator(".plot-travel canvas").first.wait_for()
            return page

        yield at
        for context in contexts:
            context.close()


def height_of(page) -> int:
    """How long a page is, pixels."""
    return int(page.evaluate("document.documentElement.scrollHeight"))


def test_on_a_phone_it_is_half_as_long_and_no_wider(opened) -> None:
    """What is behind a finding opens when it is asked for; nothing is lost."""
    page = opened(390)
    assert height_of(page) <= MOST_PIXELS
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    behind = page.locator("details.behind")
    assert behind.count() == 3
    assert page.get_by_text("all together").is_hidden()
    behind.first.locator("summary").first.click()
    assert page.get_by_text("all together").is_visible()


def test_at_a_desk_it_stands_open(opened) -> None:
    """There is room for it there."""
    page = opened(1200)
    assert page.get_by_text("all together").is_visible()
    assert page.locator("details.behind:not([open])").count() == 0


def test_on_paper_no_plot_is_cut_off(opened) -> None:
    """A plot that was drawn for a wide window is as wide as the sheet."""
    page = opened(1200)
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 700, "height": 1000})
    widths = page.locator(".plot-travel canvas, .plot-loop canvas").evaluate_all(
        "all => all.map(one => one.getBoundingClientRect().right)"
    )
    assert widths
    assert max(widths) <= 700
