"""A valve's page with everything on it: short on a phone, open at a desk, whole on paper."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stemwatch.connectors.connector import Window
from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Effect, EffectEvidence, Mismatch, Untestable
from stemwatch.models.mismatch.identifiability import PHYSICS
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.verdict import Verdict
from stemwatch.models.without_position.suspicion import Suspicion, WithoutPosition
from stemwatch.service.config import load_plant
from stemwatch.service.presenter.advice import term_words
from stemwatch.service.web.site import Site
from tests.service.example_mismatches import named
from tests.service.web import example_plant
from tests.service.web.signed_in import cookie_of

pytestmark = pytest.mark.browser
# Half of what it was when all of it stood open below each other.
MOST_PIXELS = 6350
WHY = "the stem slipped 0 times rising and 0 times falling; sizes are compared from 3 each way"
PROCESS = """
[valves.tags.pv]
tag = "FIC-101.PV"
unit = "t/h"
low = 0.0
high = 40.0
[valves.tags.sp]
tag = "FIC-101.SP"
unit = "t/h"
low = 0.0
high = 40.0
"""
# As long as they are on the valve FIC-115 of the demo, whose page was measured.
LATE = (
    "The valve answers 2.50 (2.16 to 2.84) s after its command, by the same delay every time: a "
    "delay on the way of the command, or clocks of OP and MV that differ."
)
SLOW = (
    "The valve moves at no more than 0.484 (0.456 to 0.513) %/s when falling but is free when "
    "rising: check the exhaust restriction, the booster or the supply."
)
REASON = "The stem follows: S is 0.6 % (0.4 % to 0.8 %). S and J alone would have read S as 1.3 %."
NOTE = (
    "It lowers the error on unseen blocks of time by 45 % (11.0 standard errors); no other effect "
    "of the catalogue does as well in its place."
)
CROSS_CHECK = WithoutPosition(
    verdict=Suspicion.NO_SIGN,
    reason="OP and PV show no sign of sticking; a valve that sticks by 1.5 % of OP or more would "
    "have shown in four cases of five.",
    advice="",
    score=0.02,
    apparent_S=Estimate.unknown("nothing is suspected", unit="%"),
)


def two_effects() -> Mismatch:
    """A delay and a speed limit, twelve that could not be shown, and thirteen rejected."""
    mismatch = named()
    slow, late = mismatch.effects
    other = mismatch.tried[-1]
    return replace(
        mismatch,
        sentence=f"{LATE} {SLOW}",
        effects=(
            replace(late, members=("dead_time",), sentence=LATE, decide="", evidence=noted(late)),
            replace(slow, sentence=SLOW, evidence=noted(slow)),
        ),
        tried=(*mismatch.tried[:2], *(replace(other, slug=slug) for slug in PHYSICS[:13])),
        not_testable=tuple(Untestable(slug=slug, reason=WHY) for slug in PHYSICS[:12]),
    )


def noted(effect: Effect) -> EffectEvidence:
    """Its evidence, with a note of the usual length."""
    return replace(effect.evidence, note=NOTE)


@pytest.fixture
def full(live: Site, tmp_path: Path) -> Site:
    """A valve with two effects, and samples of OP, MV, PV and SP."""
    live.store.samples.write(process_samples())
    file = tmp_path / "plant.toml"
    file.write_text(file.read_text("utf-8") + PROCESS, "utf-8")
    run = live.store.begin_run(command="test", software_version="test", settings_digest="")
    screening = example_plant.screening(
        example_plant.STICKY,
        Verdict.HEALTHY,
        0.58,
        0.01,
        at=example_plant.NOW + timedelta(minutes=1),
        mismatch=two_effects(),
        reason=REASON,
        without_position=CROSS_CHECK,
    )
    live.store.save(screening, run)
    return replace(
        live, plant=load_plant(file), read=with_process(example_plant.reader_of(live.store))
    )


def process_samples() -> SampleBatch:
    """PV and SP of two hours at 1 s."""
    count = 2 * example_plant.HOUR_S
    at = (round(example_plant.NOW.timestamp()) - count + np.arange(count)) * 1_000_000
    sp = 20.0 + 4.0 * np.sign(np.sin(np.arange(count) / 900.0))
    return SampleBatch(
        source=example_plant.SOURCE,
        tags=("FIC-101.PV",) * count + ("FIC-101.SP",) * count,
        at_us=np.concatenate((at, at)),
        values=np.concatenate((sp + 0.1, sp)),
        quality=np.zeros(2 * count, dtype=np.uint8),
        reasons=("",) * (2 * count),
    )


def with_process(read: Callable[[str, Window], Recording | None]) -> Any:
    """The recordings of ``read``, with PV and SP beside OP and MV."""

    def reader(valve: str, window: Window) -> Recording | None:
        recording = read(valve, window)
        if recording is None:
            return None
        pv = Signal.good(20.0 + 0.1 * recording.op.values, "FIC-101.PV", unit="t/h")
        sp = Signal.good(np.full(len(recording), 20.0), "FIC-101.SP", unit="t/h")
        return replace(recording, signals={**recording.signals, Role.PV: pv, Role.SP: sp})

    return reader


@pytest.fixture
def opened(full: Site, windows):
    """Opens the valve's page in a window of this width."""
    with example_plant.serving(full) as base:

        def at(width: int):
            (name, value) = next(iter(cookie_of(full).items()))
            page = windows.open(
                f"{base}/valve?id={example_plant.STICKY}",
                cookies=[{"name": name, "value": value, "url": base}],
                viewport={"width": width, "height": 850},
            )
            for name in ("travel", "process", "loop", "S", "J"):
                page.locator(f".plot-{name} canvas").first.wait_for()
            return page

        yield at
        windows.close()


def height_of(page) -> int:
    """How long a page is, pixels."""
    return int(page.evaluate("document.documentElement.scrollHeight"))


def test_on_a_phone_it_is_half_as_long_and_no_wider(opened) -> None:
    """What is behind a finding opens when it is asked for; nothing is lost."""
    page = opened(390)
    assert height_of(page) <= MOST_PIXELS
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    behind = page.locator("details.behind")
    assert behind.count() == 5
    for text in ("all together", NOTE.partition(";")[0]):
        assert page.get_by_text(text).first.is_hidden()
    for summary in ("Where it shows, and the evidence", "The numbers behind it"):
        page.get_by_text(summary).first.click()
    for text in ("all together", NOTE.partition(";")[0]):
        assert page.get_by_text(text).first.is_visible()


def test_what_to_do_next_is_said_once(opened) -> None:
    """The first effect's check is what to do next; the effect refers to it."""
    page = opened(390)
    check = term_words("dead_time").check
    assert page.locator("article").inner_text().count(check) == 1
    assert page.get_by_text("What stands above under").count() == 1


@pytest.mark.long
def test_at_a_desk_it_stands_open(opened) -> None:
    """There is room for it there."""
    page = opened(1200)
    assert page.get_by_text("all together").is_visible()
    assert page.locator("details.behind:not([open])").count() == 0


@pytest.mark.long
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
