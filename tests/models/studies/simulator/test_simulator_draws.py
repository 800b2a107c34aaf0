"""The drawn populations hold what their descriptions promise."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator import demo_plant, draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.draws import HEALTHY_STORIES
from stemwatch.models.studies.simulator.loop import PlantLoop, ProcessKind
from stemwatch.models.studies.simulator.simulate import SimulatedLoop
from stemwatch.models.verdict import Shape


def _short(loop: PlantLoop, duration_s: float = 900.0) -> PlantLoop:
    return replace(loop, duration_s=duration_s)


def test_healthy_loops_are_healthy_and_of_all_sorts() -> None:
    """Healthy draws span all stories and processes, with and without positioner."""
    loops = draw_healthy(60, seed=11)
    assert all(loop.valve.healthy for loop in loops)
    assert {f"healthy, {story}" for story in HEALTHY_STORIES} == {loop.story for loop in loops}
    assert set(ProcessKind) == {loop.process.kind for loop in loops}
    assert 10 < sum(loop.valve.positioner_gain > 0.0 for loop in loops) < 50
    assert all(0.1 <= loop.valve.S_read <= 0.6 for loop in loops)


def test_sticky_loops_have_the_four_shapes() -> None:
    """Sticky draws take the four shapes in turn, with S and J in the promised ranges."""
    loops = draw_sticky(40, seed=11)
    assert list(Shape) * 10 == [loop.valve.shape for loop in loops]
    assert not any(loop.valve.healthy for loop in loops)
    assert all(1.5 <= round(loop.valve.S_read, 9) <= 10.0 for loop in loops)
    assert all(loop.valve.J_read <= 1.3001 * loop.valve.S_read for loop in loops)
    drawn_past = [loop for loop in loops if loop.valve.positioner_gain > 0.0]
    assert {Shape.OVERSHOOT} == {loop.valve.shape for loop in drawn_past}


def test_a_longer_draw_begins_like_a_shorter_one() -> None:
    """The first loops of a draw do not depend on how many are asked for."""
    assert draw_healthy(3, seed=4) == draw_healthy(8, seed=4)[:3]
    assert draw_sticky(3, seed=4) == draw_sticky(8, seed=4)[:3]
    assert draw_sticky(3, seed=4) != draw_sticky(3, seed=5)


@pytest.mark.long
def test_every_drawn_loop_stays_in_bounds() -> None:
    """OP, stem and PV of every drawn loop are finite and between 0 and 100 %."""
    for loop in draw_healthy(12, seed=2) + draw_sticky(12, seed=2):
        run = simulate_loop(_short(loop), seed=2)
        for values in (run.recording.op.values, run.stem, run.recording.signals[Role.PV].values):
            assert np.isfinite(values).all(), loop.tag
            assert 0.0 <= values.min() <= values.max() <= 100.0, loop.tag


def test_every_limit_cycle_loop_cycles() -> None:
    """Each drawn loop that is said to cycle by itself crosses its S again and again."""
    loops = [x for x in draw_sticky(36, seed=6) if x.story.endswith("limit cycle")]
    assert len(loops) >= 6
    for loop in loops:
        op = simulate_loop(_short(loop, 3600.0), seed=6).recording.op.values[1800:]
        assert np.ptp(op) > 0.6 * loop.valve.S_read, loop.story


def test_the_demo_plant_is_complete() -> None:
    """Fifteen valves with one tag each, two hours at 1 s, every sort of trouble among them."""
    loops = demo_plant(seed=1)
    assert 15 == len(loops) == len({loop.tag for loop in loops})
    assert {7200.0} == {loop.duration_s for loop in loops}
    assert all(loop.description and loop.area for loop in loops)
    assert {1, 2, 3} == {loop.criticality for loop in loops}
    assert 10 == sum(loop.valve.healthy for loop in loops)
    assert set(Shape) == {loop.valve.shape for loop in loops if not loop.valve.healthy}


@pytest.mark.long
def test_the_demo_recordings_show_their_trouble() -> None:
    """What the story of a demonstration valve says is in its recording."""
    loops = {loop.story: loop for loop in demo_plant(seed=1)}

    @cache
    def run_of(story: str) -> SimulatedLoop:
        return simulate_loop(loops[story], seed=1)

    quiet = run_of("healthy, too few movements")
    assert np.ptp(quiet.stem) < 1.0
    blind = run_of("sticky, undershoot, no position transmitter")
    assert blind.recording.mv is None
    manual = run_of("healthy, manual mode")
    assert 0.0 == manual.recording.signals[Role.MODE].values.max()
    bad = run_of("healthy, bad data")
    assert 0.8 < bad.recording.usable.mean() < 0.99
    frozen = run_of("healthy, position transmitter frozen").recording.mv
    assert frozen is not None
    assert 0.0 == np.ptp(frozen.values[1300:])
    assert 90.0 < (run_of("healthy, oscillating disturbance").truth.period_s or 0.0) < 100.0
    for story in ("sticky, undershoot", "sticky, no offset", "sticky, overshoot"):
        moved = np.abs(np.diff(run_of(story).stem)).sum()
        assert moved > 20.0 * run_of(story).truth.J, story
