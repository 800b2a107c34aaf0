"""A stem that lets go in time with what its command does not have is seen to be shaken."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch.acceptance.shaken_stem import LEAST_POWER, power, spectrum
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.studies.simulator.hidden import (
    draw_nulls,
    draw_unknown,
)


def explained(case):
    """The recording of a hidden case, explained."""
    return explain(case.simulated().recording)


def test_breakaways_in_time_have_their_power_at_that_frequency():
    """Rising at one phase and falling half a swing later, each within a sample or two."""
    rng = np.random.default_rng(1)
    side = rng.choice([-1.0, 1.0], 80)
    turns = np.sort(rng.choice(350, 80, replace=False))
    at = np.rint(10.0 * turns + 5.0 * (side > 0.0) + rng.uniform(-1.5, 1.5, 80)).astype(np.int64)
    frequencies, powers = spectrum(at + 5, side, 3600)
    best = powers.argmax()
    assert frequencies[best] == pytest.approx(0.1, abs=2e-4)
    assert powers[best] > 0.6 * 80
    assert powers[best] == pytest.approx(power(at + 5, side, frequencies[best]))


@pytest.mark.parametrize("seed", range(8))
def test_breakaways_at_any_time_stay_below_the_limit(seed):
    """The largest power of so many frequencies is one of chance."""
    rng = np.random.default_rng(seed)
    at, side = np.sort(rng.integers(0, 3600, 100)), rng.choice([-1.0, 1.0], 100)
    assert spectrum(at, side, 3600)[1].max() < LEAST_POWER


def test_breakaways_to_one_side_tell_nothing():
    """Readings that are taken every few seconds time both sides alike."""
    assert not spectrum(np.arange(0, 200, 5), np.ones(40), 200)[1].any()
    assert power(np.arange(0), np.ones(0), 0.2) == 0.0


@pytest.mark.parametrize(
    ("concealment", "period"),
    [
        ("quantised", "4.74"),
        pytest.param("compressed", "3.65", marks=pytest.mark.long),
    ],
)
def test_a_stem_that_is_shaken_is_unknown_with_its_period(concealment, period):
    """Steps and an archive hide what is left of single slips, but not when they come."""
    index = {"quantised": 15, "compressed": 20}[concealment]
    answer = explained(draw_unknown(index + 1, 4063, concealment)[index])
    assert answer.finding is Finding.UNKNOWN
    assert f"in time with a swing of {period} s that OP does not have" in answer.sentence
    assert answer.restated == answer.naive


@pytest.mark.long
def test_an_oscillating_loop_shakes_nothing():
    """Its own swing is in OP, and the model keeps time with it too: power 64 and 31."""
    for case in (draw_nulls(15, 4063, "routine")[14], draw_nulls(48, 4064)[47]):
        assert explained(case).finding is Finding.NONE
