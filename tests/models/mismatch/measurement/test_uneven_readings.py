"""One age for each reading, one for each move, or one for all: which of them a position shows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.mismatch.measurement.uneven_readings import HALF_WIDTHS, find_uneven_readings
from stemwatch.models.recording import Floats
from stemwatch.models.studies.simulator.hidden import draw_effect

SIGMA = 0.05
SAMPLES = 1800


def stem(seed: int):
    """(n,) a stem that rests for 20 to 40 s, slips by 1 to 3 %, and slides on for some seconds."""
    rng = np.random.default_rng(seed)
    position = 50.0
    course: list[Floats] = []
    while sum(map(len, course)) < SAMPLES:
        side = 1.0 if position < 50.0 else -1.0
        slip, slide = rng.uniform(1.0, 3.0), rng.uniform(0.2, 0.8) * np.arange(1, 6)
        moved = position + side * np.concatenate([[slip], slip + slide])
        course += [np.full(rng.integers(20, 40), position), moved]
        position = float(moved[-1])
    return np.concatenate(course)[:SAMPLES]


def read(course, ages, seed: int):
    """(n,) the readings of a stem ``ages`` (n,) samples before their stamps, with noise."""
    places = np.arange(course.size)
    noise = np.random.default_rng(seed).normal(0.0, SIGMA, course.size)
    return np.interp(places - ages, places, course) + noise


def found(course, mv):
    """What is found with all readings real."""
    return find_uneven_readings(course, mv, np.ones(course.size, dtype=bool), SIGMA)


@given(seed=st.integers(0, 10_000), half_width=st.sampled_from(HALF_WIDTHS))
@settings(max_examples=20, deadline=None)
def test_readings_of_uneven_age_are_found_with_their_spread(seed, half_width):
    """Every sample has an age of its own: found, and no wider or narrower than a step of the
    widths that are tried."""
    course = stem(seed)
    ages = np.random.default_rng(seed + 1).uniform(-half_width, half_width, SAMPLES)
    uneven = found(course, read(course, ages, seed + 2))
    assert uneven is not None
    assert uneven.half_width == pytest.approx(half_width, abs=0.5)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_a_stem_that_is_where_the_model_has_it_is_not_uneven(seed):
    """Nothing but noise."""
    course = stem(seed)
    assert found(course, read(course, np.zeros(SAMPLES), seed + 2)) is None


@given(seed=st.integers(0, 10_000), late=st.floats(0.2, 2.0))
@settings(max_examples=20, deadline=None)
def test_moves_that_come_early_or_late_as_a_whole_are_not_uneven(seed, late):
    """A breakaway that scatters shifts all samples of its move by one amount."""
    course, rng = stem(seed), np.random.default_rng(seed + 1)
    begins = np.flatnonzero(np.abs(np.diff(course)) > 0.9)
    of_move = np.searchsorted(begins - 8, np.arange(SAMPLES))
    ages = rng.uniform(-late, late, begins.size + 1)[of_move]
    assert found(course, read(course, ages, seed + 2)) is None


def test_a_stem_that_never_moves_says_nothing():
    """There is nothing in it by which an age could be seen."""
    course = np.full(SAMPLES, 42.0)
    assert found(course, read(course, np.zeros(SAMPLES), 1)) is None


@pytest.mark.long
@pytest.mark.parametrize(
    ("valves", "said_of"), [(2, 1), pytest.param(8, 2, marks=pytest.mark.long)]
)
def test_readings_of_uneven_age_are_no_dead_time(valves, said_of):
    """A position that a gateway polls when it can is late on the average, and no part of the valve
    is: nothing is named, and where the delay was fitted the clock is said with the oldest age."""
    drawn = draw_effect("sampling_jitter", 20, 4070)
    polled = [one for one in drawn if one.sizes["sampling_jitter.jitter_s"] > 1.5]
    said = []
    for case in polled[:valves]:
        answer = explain(case.simulated().recording)
        assert answer.effects == ()
        latest_s = case.sizes["sampling_jitter.jitter_s"]
        said += [(one, latest_s) for one in answer.record_effects if one.slug == "sampling_jitter"]
        assert answer.finding in (Finding.NONE, Finding.UNKNOWN)
    assert len(said) >= said_of
    for uneven, latest_s in said:
        assert uneven.parameters["latest_s"] == pytest.approx(latest_s, abs=1.0)
        assert "older than its stamp" in uneven.sentence


def test_a_dead_time_stays_a_dead_time():
    """All samples of all moves are late by the same."""
    run = draw_effect("dead_time", 1, 4000)[0].simulated()
    answer = explain(run.recording)
    assert "dead_time" in answer.effects[0].members
    assert all(one.slug != "sampling_jitter" for one in answer.record_effects)


@pytest.mark.parametrize("valves", [1, pytest.param(4, marks=pytest.mark.long)])
def test_nothing_quicker_than_its_averages_is_named(valves):
    """Behind averages of a few seconds each slip has a sample on its way, which looks like a lag or
    like drag of less than the block."""
    drawn = draw_effect("sampling_jitter", 60, 4070)
    averaged = [one for one in drawn if one.sizes["sampling_jitter.average_s"] == 3.0]
    assert len(averaged) >= 4
    for case in averaged[:valves]:
        answer = explain(case.simulated().recording)
        assert answer.effects == ()
