"""Intervals hold the truth, shrink with data, grow with noise, and are repeatable."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import CAREFUL, search
from stemwatch.models.mismatch.fit.uncertainty import REPLICATES, draws, estimate
from stemwatch.models.mismatch.search.reading_errors import pinned
from stemwatch.models.mismatch.stiction import MODEL_ERROR, stiction
from stemwatch.models.recording import PERCENT
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)

TRUTH = {"S": 4.0, "J": 1.2, "theta": 2.6}


@cache
def drawn(noise=0.05, samples=1800, seed=1):
    """Draws of S, J and dead time of a valve whose command comes 2.6 s late."""
    evaluator = evaluator_of(
        simulated_by_chain(noise=noise, samples=samples, seed=seed, dead_time=[2.6])
    )
    layout = evaluator.layout(hypothesis("dead_time"))
    everything = np.ones(evaluator.problem.n_blocks, dtype=bool)
    start = candidate(layout, 3.8, 1.0, dead_time=[2.4])
    best = conclude(
        evaluator, search(evaluator, layout, everything, start[None], CAREFUL)
    ).candidate
    drawn_values = draws(evaluator, layout, best)
    return evaluator, layout, best, drawn_values


def numbers(row, layout):
    """S and J in percent and the dead time of a candidate, or of draws."""
    row = np.atleast_2d(row)
    S = row[:, base_coordinate.S_PERCENT]
    theta = row[:, layout.places["dead_time"]][:, 0]
    return {"S": S, "J": S * row[:, base_coordinate.RATIO], "theta": theta}


def width(name, **how):
    """Width of the 95 % interval of a number."""
    _, layout, _, result = drawn(**how)
    low, high = np.percentile(numbers(result, layout)[name], (2.5, 97.5))
    return float(high - low)


def test_draws_lie_within_the_limits_about_the_best():
    """One row for each replicate, inside the bounds; what is held stays held."""
    _, layout, best, result = drawn()
    assert (REPLICATES, layout.size) == result.shape
    np.testing.assert_array_equal(layout.bounds.clip(result), result)
    assert not result[:, base_coordinate.DELAY].any()
    for name, values in numbers(result, layout).items():
        assert float(np.median(values)) == pytest.approx(numbers(best, layout)[name][0], abs=0.1)


def test_a_held_coordinate_does_not_vary_in_the_bootstrap():
    """A gain that is held at 1 is 1 in every draw."""
    evaluator, layout, best, _ = drawn()
    held = pinned(layout, base_coordinate.GAIN, 0.0)
    drawn_values = draws(evaluator, held, held.bounds.clip(best))
    assert not drawn_values[:, base_coordinate.GAIN].any()
    assert np.ptp(drawn_values[:, base_coordinate.S_PERCENT]) > 0.0


def test_the_same_recording_gives_the_same_draws():
    """Draws are seeded."""
    evaluator, layout, best, result = drawn()
    np.testing.assert_array_equal(draws(evaluator, layout, best), result)


@pytest.mark.parametrize("name", TRUTH)
def test_intervals_hold_the_truth_about_95_percent_of_the_time(name):
    """Of twelve recordings of one valve, at most two intervals miss: S and J with the model error
    that is added to them, the dead time by more than 5 ms."""
    missed = 0
    for seed in range(1, 13):
        _, layout, best, result = drawn(samples=900, seed=seed)
        of_best = {key: float(value[0]) for key, value in numbers(best, layout).items()}
        level = 0.5 * (of_best["S"] + of_best["J"])
        error, slack = (0.0, 0.005) if name == "theta" else (MODEL_ERROR * level, 0.0)
        of = estimate(numbers(result, layout)[name], of_best[name], PERCENT, error)
        missed += not of.low - slack <= TRUTH[name] <= of.high + slack
    assert missed <= 2


def test_noise_widens_and_data_narrow_an_interval():
    """Six times the noise, or a quarter of the record, widens the intervals of S and dead time."""
    for name in ("S", "theta"):
        assert width(name, noise=0.3) > 1.5 * width(name)
    assert width("theta", samples=600) > width("theta", samples=2400)


@given(
    st.lists(st.floats(-50.0, 50.0), min_size=2, max_size=40),
    st.floats(-50.0, 50.0),
    st.floats(0.0, 5.0),
)
def test_an_interval_holds_its_value_and_errors_add_in_quadrature(values, best, error):
    """low <= value <= high; a model error widens each side to the root of the sum of squares."""
    values = np.array(values)
    plain, wide = estimate(values, best, "s"), estimate(values, best, "s", error)
    assert plain.low <= plain.value == best <= plain.high
    assert "s" == plain.unit
    inner_low, inner_high = np.percentile(values, (2.5, 97.5))
    assert plain.low == pytest.approx(min(inner_low, best), abs=1e-9)
    assert plain.high == pytest.approx(max(inner_high, best), abs=1e-9)
    for before, after in (
        (best - plain.low, best - wide.low),
        (plain.high - best, wide.high - best),
    ):
        assert after == pytest.approx(np.hypot(before, 1.96 * error), abs=1e-9)


def test_beside_a_named_lag_the_intervals_of_S_and_J_are_wider():
    """The same fit and draws: an error of 12 % of the level or 0.2 % instead of 8 % or 0.1 %."""
    best = np.zeros(base_coordinate.N_BASE)
    best[base_coordinate.S_PERCENT], best[base_coordinate.RATIO] = 6.0, 0.0

    def told(evaluator, with_lag):
        return stiction(evaluator, lambda: best[None, :], best, (), with_lag=with_lag)

    evaluator = evaluator_of(simulated_by_chain())
    plain, with_lag = told(evaluator, False), told(evaluator, True)
    assert plain.S.high - plain.S.value == pytest.approx(1.96 * 0.08 * 3.0)
    assert with_lag.S.high - with_lag.S.value == pytest.approx(1.96 * 0.12 * 3.0)
    assert plain.S.value == with_lag.S.value == 6.0
    assert with_lag.J.low == 0.0
