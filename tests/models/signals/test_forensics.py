"""What recorder and historian did to a signal, found in the numbers alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.signals.forensics import (
    coarse_step,
    interpolated,
    longest_repeat,
    noise_sigma,
    position_step,
    quantum,
    repeat_share,
)

rng = np.random.default_rng(5)
NOISE = rng.standard_normal(4000)
WALK = np.cumsum(rng.standard_normal(2000)) * 0.4


def swinging_door(values, deviation):
    """The knots a swinging door keeps, joined by lines: what a compressing archive hands out."""
    kept, anchor, low, high = [0], 0, -np.inf, np.inf
    for k in range(1, len(values)):
        span = k - anchor
        low = max(low, (values[k] - deviation - values[anchor]) / span)
        high = min(high, (values[k] + deviation - values[anchor]) / span)
        if low > high:
            anchor = k - 1
            kept.append(anchor)
            low = values[k] - deviation - values[anchor]
            high = values[k] + deviation - values[anchor]
    kept.append(len(values) - 1)
    return np.interp(np.arange(len(values)), kept, np.asarray(values)[kept])


@pytest.mark.parametrize("sigma", [0.02, 0.3])
def test_noise_is_seen_on_a_ramp_with_slips(sigma):
    """Steady motion and slips do not enter the noise."""
    k = np.arange(4000)
    stem = 0.5 * k + 5.0 * (k // 100) + sigma * NOISE
    assert abs(noise_sigma(stem) / sigma - 1.0) < 0.1


def test_noise_of_clean_and_short_signals():
    """A clean ramp, a constant and two samples have no noise."""
    assert noise_sigma(np.arange(100.0)) < 1e-9
    assert 0.0 == noise_sigma(np.full(100, 7.0))
    assert 0.0 == noise_sigma(np.array([1.0, 2.0]))
    assert 0.0 == noise_sigma(np.full(100, np.nan))


def test_noise_skips_gaps():
    """A gap is no step: noise with holes has the same noise."""
    holed = np.where(rng.random(4000) < 0.2, np.nan, 0.1 * NOISE)
    assert abs(noise_sigma(holed) / 0.1 - 1.0) < 0.15


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([0.01, 0.1, 0.25, 0.5, 1.0]),
    st.sampled_from([0.0, 0.03, -7.77]),
    st.integers(0, 99),
)
def test_quantum_is_the_lattice(step, offset, seed):
    """A signal rounded to a lattice shows its step, wherever the lattice lies."""
    walk = np.cumsum(np.random.default_rng(seed).standard_normal(800)) * 2.0 * step
    result = quantum(np.round(walk / step) * step + offset)
    assert abs(result / step - 1.0) < 1e-3


@pytest.mark.parametrize("decimals", [1, 2])
def test_quantum_of_printed_digits(decimals):
    """Numbers printed with few digits show their last digit, although binary rounds it."""
    values = np.array([float(f"{v:.{decimals}f}") for v in WALK])
    assert abs(quantum(values) - 10.0**-decimals) < 1e-9


@pytest.mark.parametrize("values", [NOISE, WALK, 50.0 + 10.0 * np.sin(np.arange(2000) / 20.0)])
def test_no_quantum_without_a_lattice(values):
    """Noise, a walk and a smooth sine have no step."""
    assert 0.0 == quantum(values)


def test_noise_on_top_hides_a_lattice():
    """A lattice whose noise is as large as its step is not a coarse recorder."""
    assert 0.0 == quantum(np.round(WALK / 0.5) * 0.5 + 0.2 * NOISE[:2000])


def test_few_changes_show_no_lattice():
    """Fewer than eight changes cannot tell a lattice from chance."""
    assert 0.0 == quantum(np.repeat([0.0, 1.0, 3.0, 2.0], 100))
    assert 0.0 == quantum(np.full(100, np.nan))
    assert 0.0 == quantum(np.array([]))


def test_a_stem_that_rests_long_shows_its_recorders_step():
    """A hundred changes that lie on a lattice show the step, however rare they are; a few round
    numbers that an operator set do not."""
    places = np.repeat(np.cumsum(np.where(NOISE[:120] > 0.0, 0.5, -0.5)), 30)
    assert repeat_share(places) > 0.95
    assert coarse_step(places) == pytest.approx(0.5)
    assert coarse_step(places[: 30 * 40]) == 0.0


def test_few_changes_of_a_position_show_its_recorders_step():
    """Forty changes of several sizes on a lattice are the recorder's step, for nobody sets a
    position by hand; slips that are all alike, and a signal without a lattice, show none."""
    slips = np.round(np.abs(NOISE[:40]) * 3.0) + 1.0
    places = np.repeat(np.cumsum(0.5 * slips * np.where(np.arange(40) % 2, 1.0, -1.0)), 30)
    assert coarse_step(places) == 0.0
    assert position_step(places) == pytest.approx(0.5)
    alike = np.repeat(np.where(np.arange(40) % 2, 52.0, 50.0), 30)
    assert position_step(alike) == 0.0
    assert position_step(WALK) == 0.0


def test_repeats():
    """Share and longest run count exact repeats of neighbours, and no pair across a gap."""
    values = np.array([1.0, 1.0, 1.0, 2.0, 2.0, np.nan, np.nan, 2.0])
    assert 0.75 == repeat_share(values)
    assert 3 == longest_repeat(values)
    assert 1 == longest_repeat(np.arange(5.0))
    assert 1 == longest_repeat(np.array([]))
    assert 0.0 == repeat_share(np.array([1.0]))


@pytest.mark.parametrize("deviation", [0.5, 2.0])
def test_swinging_door_is_seen(deviation):
    """Most samples of a compressed walk lie on lines between its knots."""
    assert interpolated(swinging_door(WALK, deviation)).mean() > 0.3


def test_a_swinging_door_printed_with_few_digits_is_seen():
    """Six digits of a compressed signal still lie on their lines."""
    printed = np.array([float(f"{v:.9g}") for v in swinging_door(WALK, 2.0)])
    assert interpolated(printed).mean() > 0.3


def test_noise_and_rests_are_not_interpolated():
    """Noise almost never lies on a line, and a flat stretch is a repeat, not a line."""
    assert interpolated(NOISE).mean() < 0.001
    assert not interpolated(np.repeat([1.0, 4.0], 50)).any()


def test_interpolation_at_the_ends_and_in_gaps():
    """First and last sample have no neighbours on both sides; a gap has no line."""
    line = np.arange(10.0)
    line[5] = np.nan
    expected = [False, True, True, True, False, False, False, True, True, False]
    assert expected == interpolated(line).tolist()
    assert [False, False] == interpolated(np.array([1.0, 2.0])).tolist()
