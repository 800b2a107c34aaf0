"""Reversals, travel, swing and slips."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.signals.excitation import (
    at_limits,
    jumps_from_rest,
    ranges,
    reversals,
    swing,
    travel,
)

walks = st.lists(st.integers(-20, 20), min_size=1, max_size=120).map(
    lambda steps: np.cumsum(np.array(steps, dtype=float)) * 0.25
)


def zigzag(values, threshold):
    """Turning points found the slow way: walk on, remember the extreme, turn when it is left."""
    turns, direction, extreme = [], 0, 0
    high = low = 0
    for k, value in enumerate(values):
        if direction == 0:
            high = k if value > values[high] else high
            low = k if value < values[low] else low
            if values[high] - value >= threshold:
                direction, extreme = -1, k
            elif value - values[low] >= threshold:
                direction, extreme = 1, k
        elif direction * (value - values[extreme]) > 0:
            extreme = k
        elif direction * (values[extreme] - value) >= threshold:
            turns.append(extreme)
            direction, extreme = -direction, k
    return turns


@settings(max_examples=200, deadline=None)
@given(walks, st.sampled_from([0.25, 1.0, 3.0]))
def test_reversals_are_the_zigzag(values, threshold):
    """The compiled zigzag finds what a plain walk along the signal finds."""
    assert zigzag(values, threshold) == reversals(values, threshold).tolist()


@settings(max_examples=100, deadline=None)
@given(walks, st.sampled_from([0.25, 1.0, 3.0]))
def test_reversals_alternate_by_at_least_the_threshold(values, threshold):
    """Between neighbouring reversals the signal moves by the threshold or more, to and fro."""
    moves = np.diff(values[reversals(values, threshold)])
    assert (np.abs(moves) >= threshold).all()
    assert (moves[1:] * moves[:-1] < 0).all()


def test_noise_below_the_threshold_makes_no_reversal():
    """A noisy sine turns twice per period and no more."""
    k = np.arange(1000)
    rng = np.random.default_rng(0)
    values = 5.0 * np.sin(2 * np.pi * k / 100.0) + rng.uniform(-0.4, 0.4, k.size)
    assert 20 == reversals(values, 1.0).size


def test_monotone_and_constant_signals_never_turn():
    """A ramp, a constant and a single sample have no reversal and the travel they show."""
    assert 0 == reversals(np.arange(10.0), 0.5).size
    assert 0 == reversals(np.full(10, 3.0), 0.0).size
    assert 0 == reversals(np.array([1.0]), 0.5).size
    assert 9.0 == travel(np.arange(10.0), 0.5)
    assert 0.0 == travel(np.full(10, 3.0), 0.5)
    assert 0.0 == travel(np.array([1.0]), 0.5)


def test_travel_is_the_way_without_the_noise():
    """The travel of a noisy triangle is that of the triangle, within the noise at each reversal."""
    rng = np.random.default_rng(1)
    triangle = np.interp(np.arange(401), [0, 100, 200, 300, 400], [0.0, 10.0, 0.0, 10.0, 0.0])
    noisy = triangle + 0.2 * rng.standard_normal(401)
    assert np.abs(np.diff(noisy)).sum() > 80.0
    assert abs(travel(noisy, 1.5) - 40.0) < 4.0


def test_slips_are_jumps_after_a_pause():
    """Each jump counts once, however many samples it takes; noise and slow motion do not."""
    rng = np.random.default_rng(2)
    stem = np.repeat([50.0, 52.0, 54.0, 51.0], 50)
    stem = np.concatenate((stem, np.linspace(51.0, 56.0, 3), np.full(50, 56.0)))
    op = np.full(stem.size, 50.0)
    assert 4 == jumps_from_rest(stem + 0.03 * rng.standard_normal(stem.size), op, 0.03).count
    slow = np.arange(200.0) * 0.03
    assert 0 == jumps_from_rest(slow + 0.03 * rng.standard_normal(200), slow, 0.03).count


def test_a_quick_command_that_is_followed_makes_no_slip():
    """A stem that takes each step of its command with it has not slipped, however far it went."""
    op = np.repeat(np.random.default_rng(3).uniform(40.0, 60.0, 40), 20)
    assert 0 == jumps_from_rest(np.append(op[:1], op[:-1]), op, 0.02).count


def test_slips_of_short_signals():
    """Fewer than two steps hold no slip that follows a pause."""
    assert 0 == jumps_from_rest(np.array([1.0]), np.array([1.0]), 0.1).count
    assert 0 == jumps_from_rest(np.array([1.0, 9.0]), np.array([1.0, 1.0]), 0.1).count


def test_swing_leaves_out_the_extremes_and_nan():
    """The swing runs from the 1st to the 99th percentile of what is finite."""
    values = np.concatenate((np.linspace(0.0, 100.0, 1001), [1e6, np.nan]))
    assert abs(swing(values) - 98.0) < 0.2
    assert 0.0 == swing(np.full(5, np.nan))
    assert 0.0 == swing(np.array([]))


def test_limits_are_where_an_output_rests():
    """An output clipped at 0 or 100 % is at its limit; one that is centred on zero is not."""
    wave = 60.0 * np.sin(np.arange(1000.0) / 20.0)
    low, high = at_limits(np.clip(50.0 + wave, 0.0, 100.0))
    assert 0.1 < low < 0.3
    assert 0.1 < high < 0.3
    assert (0.0, 0.0) == at_limits(wave)
    assert max(at_limits(0.03 * wave)) < 0.02
    assert (0.0, 0.0) == at_limits(np.full(3, np.nan))


def test_ranges_of_runs_that_overlap_and_hold_holes():
    """Each run by itself, up to the signal's end; without a number there is no range."""
    values = np.array([1.0, 5.0, np.nan, 2.0, 9.0, np.nan, 3.0])
    runs = np.array([[0, 3], [1, 5], [5, 6], [4, 7], [6, 7]])
    np.testing.assert_array_equal([4.0, 7.0, np.nan, 6.0, 0.0], ranges(values, runs))
    assert 0 == ranges(values, runs[:0]).size
