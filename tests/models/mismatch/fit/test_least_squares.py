"""The descent never raises the loss, keeps to the limits, and recovers the simulated parameters."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.least_squares import descend
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)


@cache
def dead_time():
    """A quarter of an hour of a valve of S 4, J 1.2 whose command comes 2.6 s late."""
    evaluator = evaluator_of(simulated_by_chain(samples=900, dead_time=[2.6]))
    return evaluator, evaluator.layout(hypothesis("dead_time"))


@cache
def clean():
    """The same without noise, half an hour."""
    evaluator = evaluator_of(simulated_by_chain(noise=0.0, dead_time=[2.6]), delta=0.05)
    return evaluator, evaluator.layout(hypothesis("dead_time"))


def everything(evaluator):
    """All blocks of time."""
    return np.ones(evaluator.problem.n_blocks, dtype=bool)


@given(st.integers(0, 2**20), st.integers(0, 3))
@settings(max_examples=15, deadline=None)
def test_it_is_never_worse_than_its_start(seed, rounds):
    """From anywhere within the limits, on any blocks, the loss falls or stays; limits hold."""
    evaluator, layout = dead_time()
    rng = np.random.default_rng(seed)
    start = rng.uniform(layout.bounds.low, layout.bounds.high)
    blocks = rng.random(evaluator.problem.n_blocks) < 0.5
    conclusion = conclude(evaluator, descend(evaluator, layout, blocks, start, rounds))
    loss = evaluator.loss(layout, blocks)
    assert conclusion.loss <= loss(start[None])[0]
    assert loss(conclusion.candidate[None])[0] == pytest.approx(conclusion.loss, rel=1e-12)
    np.testing.assert_array_equal(layout.bounds.clip(conclusion.candidate), conclusion.candidate)
    # Sticking has no slope, and a dead time leaves no delay within a sample.
    assert conclusion.candidate[base_coordinate.RESTICK] == start[base_coordinate.RESTICK]
    assert 0.0 == conclusion.candidate[base_coordinate.DELAY]


def test_without_a_round_it_stays_where_it_is():
    """No rounds, no steps."""
    evaluator, layout = dead_time()
    start = candidate(layout, S=3.0, J=2.0, dead_time=[1.0])
    conclusion = conclude(evaluator, descend(evaluator, layout, everything(evaluator), start, 0))
    np.testing.assert_array_equal(conclusion.candidate, start)


@pytest.mark.parametrize(
    ("S", "J", "theta"), [(3.2, 0.6, 2.0), (5.0, 2.0, 3.2), (4.4, 1.8, 1.9), (3.4, 1.6, 2.6)]
)
def test_it_finds_what_made_a_noise_free_recording(S, J, theta):
    """From a fifth and more away it recovers S, J, dead time, zero and gain of the chain."""
    evaluator, layout = clean()
    start = candidate(
        layout, S, J, {base_coordinate.ZERO: 0.2, base_coordinate.GAIN: -0.02}, dead_time=[theta]
    )
    result = conclude(
        evaluator, descend(evaluator, layout, everything(evaluator), start, 30)
    ).candidate
    assert result[base_coordinate.S_PERCENT] == pytest.approx(4.0, abs=0.08)
    assert result[base_coordinate.S_PERCENT] * result[base_coordinate.RATIO] == pytest.approx(
        1.2, abs=0.08
    )
    assert result[layout.places["dead_time"]] == pytest.approx(2.6, abs=0.03)
    assert result[base_coordinate.ZERO] == pytest.approx(0.0, abs=0.03)
    assert result[base_coordinate.GAIN] == pytest.approx(0.0, abs=0.003)


def test_what_made_a_noise_free_recording_is_left_alone():
    """At the truth nothing is left to gain."""
    evaluator, layout = clean()
    truth = candidate(layout, dead_time=[2.6])
    conclusion = conclude(evaluator, descend(evaluator, layout, everything(evaluator), truth, 5))
    np.testing.assert_allclose(conclusion.candidate, truth, atol=0.02)


def test_blocks_that_are_not_chosen_do_not_count():
    """A position that is wrong in the other blocks changes neither steps nor result."""
    evaluator, layout = dead_time()
    blocks = np.arange(evaluator.problem.n_blocks) % 3 == 0
    mv = evaluator.problem.mv.copy()
    others = np.flatnonzero(~blocks[evaluator.problem.block] & evaluator.problem.scored)
    # The last sample of a block is where the resting stem of the next one is put.
    others = others[evaluator.marks[np.minimum(others + 1, mv.size - 1)] == 0]
    mv[others] += 3.0
    wrong = replace(evaluator, problem=replace(evaluator.problem, mv=mv))
    start = candidate(layout, S=3.0, J=0.6, dead_time=[1.6])
    ours, theirs = (
        conclude(item, descend(item, layout, blocks, start, 6)) for item in (evaluator, wrong)
    )
    np.testing.assert_array_equal(ours.candidate, theirs.candidate)
    assert ours.loss == theirs.loss


@given(st.integers(0, 2**20))
@settings(max_examples=15, deadline=None)
def test_a_run_does_not_depend_on_earlier_runs(seed):
    """An evaluator that has run other dead times, other hypotheses and free runs says the same."""
    evaluator, layout = dead_time()
    rng = np.random.default_rng(seed)
    first, second = rng.uniform(layout.bounds.low, layout.bounds.high, (2, layout.size))
    alone = evaluator.block_losses(layout, first[None])
    evaluator.simulate(layout, first)
    base = evaluator.layout(hypothesis())
    evaluator.block_losses(base, base.bounds.clip(first[None, : base.size]))
    evaluator.block_losses(layout, np.vstack((second, first, second)))
    np.testing.assert_array_equal(evaluator.block_losses(layout, first[None]), alone)
    same = evaluator.simulate(layout, first)
    evaluator.block_losses(layout, second[None])
    np.testing.assert_array_equal(evaluator.simulate(layout, first), same)
