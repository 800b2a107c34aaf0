"""Histograms of a stem's position: time, travel and reversals by class, strokes by length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.models.health_indicators.indicators import of_movement
from stemwatch.models.recording import PERCENT, Floats, Recording, Role, Signal
from stemwatch.models.signals.position_histograms import STROKE_EDGES, position_histograms
from stemwatch.models.stickslip.events import SlipEvents
from stemwatch.models.stickslip.problem import make_problem


def recorded(position: Floats, interval_s: float = 1.0) -> Recording:
    """A recording whose stem stood at ``position`` (n,), percent."""
    signals = {
        Role.OP: Signal.good(position, "OP", unit=PERCENT),
        Role.MV: Signal.good(position, "MV", unit=PERCENT),
    }
    return Recording(valve="FV-1", signals=signals, interval_s=interval_s)


def test_a_triangle_is_counted_by_hand() -> None:
    """25 to 45 % and back, five times: half a class at the ends has half the travel; each turn is
    in the class where it happened."""
    up = np.linspace(25.0, 45.0, 41)
    cycle = np.concatenate((up[:-1], up[::-1][:-1]))
    found = position_histograms(recorded(np.concatenate((np.tile(cycle, 5), up[:1])), 3.0))
    assert found is not None
    assert found.travel == (0, 0, 50.0, 100.0, 50.0, 0, 0, 0, 0, 0)
    assert found.reversals == (0, 0, 4, 0, 5, 0, 0, 0, 0, 0)
    assert sum(found.time) == pytest.approx(100.0, abs=0.05)
    assert found.time[3] == pytest.approx(50.0, abs=0.3)
    assert found.strokes == (0, 0, 0, 0, 0, 0, 10, 0)
    assert found.hours == pytest.approx(401 * 3.0 / 3600.0, abs=1e-4)


def test_what_reads_beyond_the_ends_is_in_the_outer_classes() -> None:
    """A transmitter's zero that is off loses nothing."""
    cycle = np.concatenate((np.linspace(-3.0, 104.0, 215), np.linspace(104.0, -3.0, 215)))
    found = position_histograms(recorded(np.tile(cycle, 5)))
    assert found is not None
    assert sum(found.travel) == pytest.approx(10 * 107.0)
    assert (found.travel[0], found.travel[-1]) == (130.0, 140.0)
    assert (found.reversals[0], found.reversals[-1]) == (4, 5)
    assert found.strokes[-1] == 10


def test_noise_hardly_moves_a_resting_stem() -> None:
    """Of the way that the reading trembles at most a tenth is counted: what is beyond five standard
    deviations."""
    noise = 0.05 * np.random.default_rng(8181).standard_normal(4000)
    found = position_histograms(recorded(62.0 + noise))
    assert found is not None
    assert sum(found.travel) < 0.1 * np.abs(np.diff(noise)).sum()
    assert found.time[6] == 100.0


def test_a_position_that_is_not_in_percent_has_no_classes() -> None:
    """Nor has a recording without one."""
    recording = recorded(np.linspace(0.0, 50.0, 100))
    volts = replace(recording.signals[Role.MV], unit="V")
    without = {Role.OP: recording.signals[Role.OP]}
    assert position_histograms(replace(recording, signals={**without, Role.MV: volts})) is None
    assert position_histograms(replace(recording, signals=without)) is None


@given(st.lists(st.floats(-5.0, 105.0), min_size=2, max_size=60))
def test_sums_are_those_of_the_indicators(positions: list[float]) -> None:
    """Travel and reversals over all classes are the indicators'; every stroke has one length."""
    recording = recorded(np.repeat(np.round(positions, 1), 3))
    found = position_histograms(recording)
    assert found is not None
    events = SlipEvents(count=0, share=0.0, towards=0.0)
    counted = {one.name: one.value for one in of_movement(make_problem(recording), events)}
    assert sum(found.travel) == pytest.approx(counted["travel_percent"], abs=0.06)
    assert sum(found.reversals) == counted["mv_reversals"]
    assert len(found.strokes) == len(STROKE_EDGES)
    assert sum(found.strokes) <= sum(found.reversals) + 1
