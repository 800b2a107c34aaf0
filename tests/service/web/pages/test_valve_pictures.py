"""A valve's page draws from the store what explain draws from the samples, and work beside it."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import timedelta

import pytest

from stemwatch.models.verdict import Verdict
from stemwatch.models.without_position.suspicion import WithoutPosition
from stemwatch.service.report.charts.window_pictures import pack_pictures, window_pictures
from tests.service.maintenance.example_work_list import with_effects
from tests.service.report.conftest import screening as with_samples
from tests.service.report.test_without_position import (
    cannot_tell,
    no_sign,
    suspected,
    with_suspected_stem,
)
from tests.service.web.example_plant import BLIND, NOW, STICKY, screening, serving
from tests.service.web.pages.test_pages_browser import DESK, PHONE, Opened
from tests.service.web.signed_in import cookie_of


def test_the_page_has_the_pictures_of_its_screening(live, client) -> None:
    """Every picture under its title, drawn as SVG, without the samples."""
    result = with_effects(STICKY)
    pictures = window_pictures(result)
    run = live.store.begin_run(software_version="1")
    stored = screening(STICKY, at=NOW + timedelta(hours=1), mismatch=result.mismatch)
    live.store.save(stored.without_samples(), run, packed_pictures=pack_pictures(pictures))
    page = client.get("/valve", params={"id": STICKY}).text
    for picture in pictures.effects:
        assert f"<figcaption>{picture.title}</figcaption>" in page
    assert page.count('class="small-plot"') == len(pictures.effects)


def test_the_page_lays_the_loops_before_and_after_work_over_each_other(live, client) -> None:
    """With what was done, S and J of both windows, and dates; without work nothing."""
    assert "Before and after the last work" not in client.get("/valve", params={"id": STICKY}).text
    run = live.store.begin_run(software_version="1")
    for days, S, J in ((3, 6.25, 2.0), (1, 0.31, 0.0)):
        loop = window_pictures(with_samples(STICKY, S=S, J=J))
        at = NOW - timedelta(days=days)
        live.store.save(
            screening(STICKY, S=S, J=J, at=at), run, packed_pictures=pack_pictures(loop)
        )
    live.store.record_maintenance(STICKY, NOW - timedelta(days=2), "seat lapped", "K. Berg")
    page = client.get("/valve", params={"id": STICKY}).text
    part = page[page.index('id="work"') :]
    part = part[: part.index("</section>")]
    text = " ".join(re.sub(r"<[^>]+>", " ", part).split())
    assert "seat lapped" in text
    assert "S 6.25 → 0.31 %" in text
    assert "J 2.00 → 0.00 %" in text
    assert part.count('class="small-plot"') == 1
    assert 'href="#work"' in page


def test_the_page_shows_what_raises_a_suspicion(live, client) -> None:
    """The pictures of the latest window where that is suspected by itself; else those of the
    clearest of the windows that count with it, and of which window they are; none where all
    together do not bear it out."""

    def save(hours: int, answer: WithoutPosition, pictures: bool) -> None:
        at = NOW + timedelta(hours=hours)
        window = screening(BLIND, Verdict.UNDETERMINED, None, None, at=at, without_position=answer)
        suspicion = with_suspected_stem(with_samples(BLIND, Verdict.UNDETERMINED), answer)
        packed = pack_pictures(window_pictures(suspicion)) if pictures else b""
        run = live.store.begin_run(software_version="1")
        live.store.save(window, run, packed_pictures=packed)

    def page() -> str:
        return str(client.get("/valve", params={"id": BLIND}).text)

    save(1, no_sign(), pictures=False)
    assert "What raises the suspicion" not in page()
    save(2, suspected(0.99), pictures=True)
    assert page().count('class="small-plot"') == 3
    assert "From the window that ended" not in page()
    save(3, suspected(0.9), pictures=True)
    earlier = replace(suspected(0.97), recordings=3, alone=no_sign())
    save(4, earlier, pictures=False)
    assert page().count('class="small-plot"') == 3
    assert "From the window that ended 2026-03-30 16:00" in page()
    save(5, replace(cannot_tell("they do not bear it out"), recordings=4), pictures=True)
    assert "What raises the suspicion" not in page()


@pytest.mark.long
@pytest.mark.browser
def test_on_a_phone_the_pictures_unfold_when_asked(windows, live) -> None:
    """At a desk they are open, on a phone folded, without scripts open; nothing runs out of the
    window once they are."""
    result = with_effects(STICKY)
    run = live.store.begin_run(software_version="1")
    stored = screening(STICKY, at=NOW + timedelta(hours=1), mismatch=result.mismatch)
    packed = pack_pictures(window_pictures(result))
    live.store.save(stored.without_samples(), run, packed_pictures=packed)
    with serving(live) as base:
        opened = Opened(windows, base, cookie_of(live))
        path = f"/valve?id={STICKY}"
        assert opened.page(path, viewport=DESK).locator(".small-plot").first.is_visible()
        bare = opened.page(path, viewport=PHONE, java_script_enabled=False)
        assert bare.locator(".small-plot").first.is_visible()
        page = opened.page(path, viewport=PHONE)
        assert not page.locator(".small-plot").first.is_visible()
        page.get_by_text("What the recording itself shows").focus()
        page.keyboard.press("Enter")
        assert page.locator(".small-plot").first.is_visible()
        assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
        assert (opened.errors, opened.foreign) == ([], [])
        opened.close()
