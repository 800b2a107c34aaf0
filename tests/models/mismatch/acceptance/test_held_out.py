"""Fits without and with effects are measured on a part that neither has seen, and reported
unchanged.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.acceptance.held_out import (
    FirstPart,
    compare_held_out,
    on_alternate_blocks,
)
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_fit import fit_base
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import CAREFUL, crossfit
from stemwatch.models.mismatch.fit.evaluator import make_evaluator
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import problem_of, summary_of
from stemwatch.models.mismatch.terms import catalogue
from tests.models.mismatch.fitted_chain import hypothesis, simulated_by_chain


@cache
def prepared(*slugs):
    """The scaled evaluator of a valve whose command comes 3 s late, and the terms in question."""
    recording = simulated_by_chain(dead_time=[3.0])
    problem = problem_of(recording, measured_record(recording))
    evaluator = fit_base(problem, summary_of(problem, problem.interval_s)).evaluator
    return evaluator, evaluator.layout(hypothesis(*slugs)), [catalogue()[slug] for slug in slugs]


@cache
def shown(*slugs):
    """What is shown of it."""
    return compare_held_out(*prepared(*slugs), None)


def with_position(evaluator, mv):
    """The same terms and scales over another position, its breakaways found anew."""
    problem = replace(evaluator.problem, mv=mv)
    result = make_evaluator(
        problem,
        evaluator.summary,
        evaluator.base_bounds,
        evaluator.delta,
        evaluator.restick,
        evaluator.scatter,
    )
    return replace(result, window=evaluator.window)


def errors(evaluator, runs):
    """RMS errors of the naive and the extended run over the held-out part, and its spread."""
    late = evaluator.problem.scored & (np.arange(evaluator.problem.op.size) >= runs.heldout_from)
    mv = evaluator.problem.mv[late]
    rms = [float(np.sqrt(np.mean((mv - run[late]) ** 2))) for run in (runs.naive, runs.extended)]
    return *rms, float(np.std(mv))


@pytest.mark.parametrize("slugs", [("dead_time",), ()])
def test_the_runs_do_not_use_the_held_out_part(slugs):
    """Another position after ``heldout_from`` changes neither run, anywhere."""
    evaluator, layout, terms = prepared(*slugs)
    before = shown(*slugs)
    first = before.runs.heldout_from
    mv = evaluator.problem.mv.copy()
    mv[first:] = 50.0 + np.random.default_rng(1).normal(0.0, 8.0, mv.size - first)
    after = compare_held_out(with_position(evaluator, mv), layout, terms, None)
    assert first == after.runs.heldout_from
    np.testing.assert_array_equal(after.runs.naive, before.runs.naive)
    np.testing.assert_array_equal(after.runs.extended, before.runs.extended)
    assert after.heldout.rmse_extended > 2.0 * before.heldout.rmse_extended


def test_another_position_in_the_first_part_changes_the_runs():
    """What is fitted does depend on the part that it is fitted to."""
    evaluator, layout, terms = prepared("dead_time")
    mv = evaluator.problem.mv.copy()
    mv[: shown("dead_time").runs.heldout_from] += 2.0
    after = compare_held_out(with_position(evaluator, mv), layout, terms, None)
    assert not np.array_equal(after.runs.extended, shown("dead_time").runs.extended)


def test_errors_and_fits_are_those_of_the_runs():
    """RMSE and fit follow from the two runs and the position after ``heldout_from``."""
    evaluator, _, _ = prepared("dead_time")
    result = shown("dead_time")
    naive, extended, spread = errors(evaluator, result.runs)
    heldout = result.heldout
    assert (naive, extended) == pytest.approx((heldout.rmse_naive, heldout.rmse_extended))
    assert heldout.fit_naive == pytest.approx(100.0 * (1.0 - naive / spread))
    assert heldout.fit_extended == pytest.approx(100.0 * (1.0 - extended / spread))
    assert heldout.gain_low <= heldout.fit_extended - heldout.fit_naive <= heldout.gain_high
    assert heldout.noise_floor == min(evaluator.problem.sigma, heldout.rmse_extended)
    assert None is heldout.rmse_ceiling


def test_the_physics_that_was_left_out_improves_the_unseen_part():
    """With the dead time the error on unseen data falls to about the noise, clearly."""
    with_it, without = shown("dead_time").heldout, shown().heldout
    assert with_it.rmse_extended < 0.15 * with_it.rmse_naive
    assert with_it.gain_low > 10.0
    # Without a term only zero and gain of the reading are free, which cannot explain the delay.
    assert without.rmse_extended > 3.0 * with_it.rmse_extended
    assert without.rmse_naive == with_it.rmse_naive


def test_the_ceiling_is_the_networks_error_on_the_same_samples():
    """Where its run has values it is scored, on the held-out part only; too few tell nothing."""
    evaluator, layout, terms = prepared("dead_time")
    mv, first = evaluator.problem.mv, shown("dead_time").runs.heldout_from
    ceiling = mv + 0.25
    ceiling[:first] = mv[:first] + 9.0
    ceiling[first : first + 50] = np.nan
    assert 0.25 == pytest.approx(
        compare_held_out(evaluator, layout, terms, ceiling).heldout.rmse_ceiling
    )
    ceiling[first + 29 :] = np.nan
    assert None is compare_held_out(evaluator, layout, terms, ceiling).heldout.rmse_ceiling
    assert None is compare_held_out(evaluator, layout, terms, mv[:-1]).heldout.rmse_ceiling


def test_where_the_unseen_part_stands_still_no_fit_is_claimed():
    """A position that is constant after ``heldout_from`` has no spread to explain."""
    evaluator, layout, terms = prepared("dead_time")
    mv = evaluator.problem.mv.copy()
    mv[shown("dead_time").runs.heldout_from :] = 50.0
    heldout = compare_held_out(with_position(evaluator, mv), layout, terms, None).heldout
    assert heldout.noise_floor == evaluator.problem.sigma
    assert {None} == {
        heldout.rmse_naive,
        heldout.rmse_extended,
        heldout.fit_naive,
        heldout.fit_extended,
    }


@cache
def crossfitted():
    """The dead time on both folds, its term, and what all hypotheses of the record share."""
    evaluator, layout, terms = prepared("dead_time")
    start = np.zeros((1, layout.size))
    start[0, [base_coordinate.S_PERCENT, base_coordinate.RATIO]] = 4.0, 0.4
    start[0, layout.places["dead_time"]] = 3.0
    fitted = conclude(evaluator, crossfit(evaluator, layout, start, CAREFUL))
    return evaluator, fitted, terms


def on_blocks(evaluator):
    """Both models on alternate blocks, over the position of ``evaluator``."""
    _, fitted, terms = crossfitted()
    return on_alternate_blocks(shown("dead_time"), fitted, terms, FirstPart(evaluator))


def test_on_alternate_blocks_no_block_tells_its_own_run():
    """Another position in the even blocks changes only the runs of the odd ones, which are fitted
    to it; all samples are unseen, and the errors are of all of them."""
    evaluator, _, _ = crossfitted()
    mv, block = evaluator.problem.mv.copy(), evaluator.problem.block
    even = (block >= 0) & (block % 2 == 0)
    even[np.flatnonzero(evaluator.problem.start)] = False  # where a run takes its place from,
    even &= np.append(even[1:], False)  # and where the runs of a next block take theirs from
    mv[even] += 2.0
    before, after = on_blocks(evaluator), on_blocks(with_position(evaluator, mv))
    assert before.runs.heldout_from == 0
    assert before.heldout.alternate_blocks
    for was, now in (
        (before.runs.naive, after.runs.naive),
        (before.runs.extended, after.runs.extended),
    ):
        assert np.array_equal(was[even], now[even])
        assert np.abs(was - now)[(block >= 0) & (block % 2 == 1)].max() > 0.5
    rms = errors(evaluator, before.runs)[:2]
    assert rms == pytest.approx((before.heldout.rmse_naive, before.heldout.rmse_extended))
    assert before.heldout.rmse_extended < 0.5 * before.heldout.rmse_naive
    assert before.heldout.gain_low > 0.0
