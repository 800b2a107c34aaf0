"""A block of time is scored by a fit that did not see it; no step of a search raises the loss."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import (
    LOOK,
    POLISH,
    Beginning,
    better,
    crossfit,
    folds,
    gain,
    refit,
    scored,
    widened,
)
from stemwatch.models.mismatch.fit.starting_points import beginnings, play_beginnings
from stemwatch.models.mismatch.terms import catalogue
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)


@cache
def prepared():
    """A quarter of an hour of a valve whose command comes 2.6 s late, and its evaluator."""
    evaluator = evaluator_of(simulated_by_chain(samples=900, dead_time=[2.6]))
    return evaluator, evaluator.layout(hypothesis("dead_time"))


def starts(layout):
    """A few places to start from."""
    sizes = [(3.0, 1.0, 1.0), (4.5, 2.0, 2.0), (6.0, 0.5, 4.0), (4.0, 1.0, 2.5)]
    return np.array([candidate(layout, S, J, dead_time=[late]) for S, J, late in sizes])


def elsewhere(evaluator, blocks):
    """The evaluator with a position that is wrong in some blocks, except at samples used elsewhere.

    The last sample before a block sets its resting stem, and the breakaways act like an input: both
    stay.
    """
    mv = evaluator.problem.mv.copy()
    inside = blocks[evaluator.problem.block] & evaluator.problem.scored
    inside[:-1] &= evaluator.marks[1:] == 0
    mv[inside] += np.random.default_rng(3).normal(0.0, 2.0, int(inside.sum()))
    return replace(evaluator, problem=replace(evaluator.problem, mv=mv))


def own_losses(evaluator, fitted):
    """(2,) the loss of each fold's candidate on the fold it was fitted to."""
    losses = evaluator.block_losses(fitted.layout, fitted.candidates)
    return np.array([row[fold].sum() for row, fold in zip(losses, folds(evaluator), strict=True)])


def at_random(evaluator, layout, seed):
    """Two candidates from anywhere within the limits, scored."""
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(layout.bounds.low, layout.bounds.high, (2, layout.size))
    return conclude(evaluator, scored(layout, drawn))


@pytest.mark.parametrize("fold", [0, 1])
def test_the_fit_that_judges_a_block_has_not_seen_it(fold):
    """Spoiling the position in one fold changes its own fit, not the one that judges it."""
    evaluator, layout = prepared()
    spoiled = elsewhere(evaluator, folds(evaluator)[fold])
    ours, theirs = (
        conclude(item, crossfit(item, layout, starts(layout), LOOK))
        for item in (evaluator, spoiled)
    )
    np.testing.assert_array_equal(ours.candidates[1 - fold], theirs.candidates[1 - fold])
    assert not np.array_equal(ours.candidates[fold], theirs.candidates[fold])
    # The held-out loss of the spoiled blocks is that of the untouched fit on what is now there.
    judged = folds(evaluator)[fold]
    of_judge = spoiled.block_losses(layout, theirs.candidates[1 - fold][None])[0]
    np.testing.assert_array_equal(theirs.heldout[judged], of_judge[judged])
    # And the other blocks are judged by the spoiled fit.
    by_spoiled = spoiled.block_losses(layout, theirs.candidates[fold][None])[0]
    np.testing.assert_array_equal(theirs.heldout[~judged], by_spoiled[~judged])


def test_neighbouring_blocks_belong_to_different_folds():
    """Every block belongs to one fold, and neighbours to different ones."""
    even, odd = folds(prepared()[0])
    assert (even ^ odd).all()
    assert (even[1:] != even[:-1]).all()


def test_both_folds_find_the_valve():
    """S, J and the dead time are found from each half of the record alone."""
    evaluator, layout = prepared()
    conclusion = conclude(evaluator, crossfit(evaluator, layout, starts(layout), LOOK))
    np.testing.assert_allclose(conclusion.values("dead_time")[:, 0], 2.6, atol=0.1)
    np.testing.assert_allclose(conclusion.candidates[:, base_coordinate.S_PERCENT], 4.0, atol=0.3)
    assert ("dead_time",) == conclusion.slugs


@given(st.integers(0, 2**20))
@settings(max_examples=8, deadline=None)
def test_refitting_never_raises_the_loss_on_a_folds_own_blocks(seed):
    """A refit from any two candidates is at least as good on the blocks that each was fitted to."""
    evaluator, layout = prepared()
    started = at_random(evaluator, layout, seed)
    more = at_random(evaluator, layout, seed + 1).candidates
    went_on = conclude(evaluator, refit(evaluator, started, POLISH, more))
    assert (own_losses(evaluator, went_on) <= own_losses(evaluator, started)).all()


@given(st.integers(0, 2**20))
@settings(max_examples=30, deadline=None)
def test_the_better_of_two_is_taken_fold_by_fold(seed):
    """``better`` has on each fold the lower of the two losses, and the held-out losses of that."""
    evaluator, layout = prepared()
    item, other = at_random(evaluator, layout, seed), at_random(evaluator, layout, seed + 1)
    accepted = better(evaluator, item, other)
    least = np.minimum(own_losses(evaluator, item), own_losses(evaluator, other))
    np.testing.assert_allclose(own_losses(evaluator, accepted), least, rtol=1e-12)
    anew = conclude(evaluator, scored(layout, accepted.candidates))
    np.testing.assert_array_equal(accepted.heldout, anew.heldout)


def test_no_model_is_better_than_itself():
    """The advantage of a fit over itself is zero, and it changes sign with the order."""
    evaluator, layout = prepared()
    item, other = at_random(evaluator, layout, 1), at_random(evaluator, layout, 2)
    itself = gain(evaluator, item, item)
    assert (0.0, 0.0) == (itself.mean, itself.t)
    there, back = gain(evaluator, item, other), gain(evaluator, other, item)
    assert there.mean == pytest.approx(-back.mean)
    assert there.t == pytest.approx(-back.t)


def test_a_repeated_search_finds_the_same():
    """Searches are seeded."""
    evaluator, layout = prepared()
    item, other = (
        conclude(evaluator, crossfit(evaluator, layout, starts(layout), LOOK)) for _ in range(2)
    )
    np.testing.assert_array_equal(item.candidates, other.candidates)


@pytest.mark.parametrize("slug", ["dead_time", "travel_stop", "lost_motion", "growing_stiction"])
def test_starts_are_the_terms_own_grid_over_each_beginning(slug):
    """Every start of the term is combined with every beginning, within the limits, and keeps the
    old terms.
    """
    evaluator, _ = prepared()
    simple = at_random(evaluator, evaluator.layout(hypothesis("sensor_drift")), 5)
    term = catalogue()[slug]
    rich = hypothesis("sensor_drift").plus(term)
    layout, started = evaluator.layout(rich), beginnings(term, 4.0, 1.0)
    rows = widened(evaluator, rich, simple, term, started)
    grid = term.starts(evaluator.summary)
    assert (len(started) * grid.shape[0], layout.size) == rows.shape
    np.testing.assert_array_equal(layout.bounds.clip(rows), rows)
    place = layout.places[slug]
    within = np.clip(grid, layout.bounds.low[place], layout.bounds.high[place])
    np.testing.assert_array_equal(rows[:, place], np.tile(within, (len(started), 1)))
    drift = simple.values("sensor_drift").mean(axis=0)
    np.testing.assert_allclose(
        rows[:, layout.places["sensor_drift"]], np.tile(drift, (len(rows), 1))
    )


def test_play_is_begun_where_the_reading_comes_to_rest_as_before():
    """S - J + b is what S - J was without it, whatever part of it S has taken up."""
    evaluator, base = prepared()[0], prepared()[0].layout(hypothesis())
    simple = at_random(evaluator, base, 5)
    term = catalogue()["lost_motion"]
    rows = widened(evaluator, hypothesis("lost_motion"), simple, term, play_beginnings(8.0, 1.0))
    S, play = rows[:, base_coordinate.S_PERCENT], rows[:, -1]
    J = S * rows[:, base_coordinate.RATIO]
    # With the least that S and J can be, no such stem has the play.
    free = (S > 0.3 * 8.0 + 1e-9) & (J > 0.05 * S + 1e-9) & (J < S - 1e-9)
    np.testing.assert_allclose((S - J + play)[free], 7.0)
    assert np.count_nonzero(free) > 10
    assert len(set(np.round(J[free & (play == play[0])], 6))) > 2


def test_a_start_subtracts_from_S_the_part_that_belongs_to_the_term():
    """Play that was fitted as part of S is subtracted from it; a plain beginning drops the biased
    reading.
    """
    evaluator, base = prepared()[0], prepared()[0].layout(hypothesis())
    centre = candidate(base, base={base_coordinate.ZERO: 1.0, base_coordinate.GAIN: 0.1})
    simple = conclude(evaluator, scored(base, np.vstack((centre, centre))))
    term = catalogue()["lost_motion"]
    started = [
        Beginning(4.0, 1.0),
        Beginning(4.0, 1.0, S_less=1.0),
        Beginning(4.0, 1.0, plain=True),
    ]
    rows = widened(evaluator, hypothesis("lost_motion"), simple, term, started)
    own, less, plain = np.split(rows, 3)
    play = less[:, -1]
    np.testing.assert_allclose(own[:, base_coordinate.S_PERCENT], 4.0)
    np.testing.assert_allclose(less[:, base_coordinate.S_PERCENT], np.maximum(4.0 - play, 1.2))
    np.testing.assert_allclose(
        own[:, [base_coordinate.ZERO, base_coordinate.GAIN]], np.tile([1.0, 0.1], (len(own), 1))
    )
    assert not plain[:, [base_coordinate.ZERO, base_coordinate.GAIN]].any()
