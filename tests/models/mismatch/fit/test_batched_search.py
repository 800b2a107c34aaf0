"""Batched searches find what each finds alone, and their requests fill the lanes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import conclude, run_together
from stemwatch.models.mismatch.fit.crossfit import CAREFUL, folds, search
from stemwatch.models.mismatch.fit.evaluator import RunRequest, batches
from stemwatch.models.mismatch.fit.forces import Forces
from stemwatch.models.mismatch.fit.least_squares import descend
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.lane_rows import LANES
from stemwatch.models.mismatch.stem_model.lanes import WIDTH, alike
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.terms import catalogue
from tests.models.mismatch.fitted_chain import evaluator_of, hypothesis, simulated_by_chain

# One of each kind of table, one without, and two that shape the command.
KINDS = (
    (),
    ("dead_time",),
    ("actuator_lag", "lost_motion"),
    ("position_dependent_friction",),
    ("dwell_dependent_breakaway",),
    ("sensor_drift",),
    ("growing_stiction", "flow_force"),
)


@cache
def evaluator():
    """A quarter of an hour of a valve whose command comes 2.6 s late, on its evaluator."""
    return evaluator_of(simulated_by_chain(samples=900, dead_time=[2.6]))


def anywhere(layout, count, rng):
    """(count, size) candidates from anywhere within the limits."""
    return rng.uniform(layout.bounds.low, layout.bounds.high, (count, layout.size))


def searches(seed):
    """A descent on one fold for every kind of hypothesis, and a careful search."""
    rng, (even, odd) = np.random.default_rng(seed), folds(evaluator())
    for i, slugs in enumerate(KINDS):
        layout = evaluator().layout(hypothesis(*slugs))
        start = anywhere(layout, 1, rng)[0]
        yield descend(evaluator(), layout, even if i % 2 else odd, start, rounds=2)
    layout = evaluator().layout(hypothesis("dead_time"))
    yield search(evaluator(), layout, even, anywhere(layout, 5, rng), CAREFUL)


@given(st.integers(0, 2**20))
@settings(max_examples=5, deadline=None)
def test_a_batched_search_finds_what_it_finds_alone(seed):
    """To the last bit: the same candidates, the same losses, in the order of the searches."""
    alone = [conclude(evaluator(), item) for item in searches(seed)]
    in_step = conclude(evaluator(), run_together(searches(seed)))
    assert len(alone) == len(in_step) == len(KINDS) + 1
    for item, other in zip(alone, in_step, strict=True):
        np.testing.assert_array_equal(item.candidate, other.candidate)
        assert item.loss == other.loss


def test_a_search_without_requests_ends_at_once():
    """No searches, and searches that return at once, need no run."""

    def known(value):
        return value
        yield

    assert conclude(evaluator(), run_together([])) == []
    assert conclude(evaluator(), run_together([known(1), known(2)])) == [1, 2]


def test_an_error_in_one_search_is_raised():
    """An exception in one of several searches is raised."""

    def wrong():
        yield [RunRequest(evaluator().layout(hypothesis()), np.zeros((1, base_coordinate.N_BASE)))]
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        conclude(evaluator(), run_together([*searches(1), wrong()]))


@given(st.lists(st.integers(1, 3 * LANES), min_size=1, max_size=12))
def test_every_candidate_runs_once_in_as_few_batches_as_can_be(counts):
    """Batches keep the order, are no larger than the lanes, and differ by one vector at most."""
    as_list = list(batches(counts))
    ran = [
        (lot, i) for batch in as_list for lot, part in batch for i in range(*part.indices(10**6))
    ]
    assert ran == [(lot, i) for lot, count in enumerate(counts) for i in range(count)]
    sizes = [sum(part.stop - part.start for _, part in batch) for batch in as_list]
    assert len(sizes) == -(-sum(counts) // LANES)
    assert max(sizes) <= LANES
    vectors = [-(-size // WIDTH) for size in sizes]
    assert max(vectors) - min(vectors) <= 1
    assert all(size % WIDTH == 0 for size in sizes[:-1])


def test_answers_are_those_of_a_candidate_alone():
    """Requests of several layouts, too many for one batch, each get their own losses."""
    rng = np.random.default_rng(3)
    layouts = [evaluator().layout(hypothesis(*slugs)) for slugs in KINDS]
    asks = [RunRequest(layout, anywhere(layout, 11, rng)) for layout in layouts]
    evaluator().answer(asks)
    for ask in asks:
        for i in (0, 5, 10):
            alone = evaluator().block_losses(ask.layout, ask.candidates[i][None])[0]
            np.testing.assert_array_equal(ask.losses[i], alone)


def test_hypotheses_run_alike_by_what_their_stems_use():
    """Levels that vary, readings that wander and what takes longer are kept apart from plain
    stems."""
    kinds = [evaluator().layout(hypothesis(*slugs)).kind for slugs in KINDS]
    plain, varied, timed = ((i == 1, i == 2, False, True) for i in range(3))
    with_play = (False, False, False, False)
    assert kinds == [plain, plain, with_play, varied, varied, timed, varied]


@pytest.mark.parametrize("slug", sorted(catalogue()))
def test_upper_limits_show_everything_that_a_term_fills(slug):
    """What a term fills anywhere within its limits it also fills at the upper ones."""
    layout = evaluator().layout(hypothesis(slug))
    varied, timed, heavy, is_alike = layout.kind
    for candidate in anywhere(layout, 5, np.random.default_rng(5)):
        stem = Stem.neutral(900, 1.0)
        for term, place in layout.filling:
            term.fill(stem, candidate[place])
        by_place, by_rest, growth, by_time = stem.numbers[
            [stem_number.BY_PLACE, stem_number.BY_REST, stem_number.GROWTH, stem_number.BY_TIME]
        ]
        assert varied or not (by_place or by_rest or growth)
        assert timed or not by_time
        assert heavy or not stem.numbers[stem_number.RUN_UP_S]
        assert not is_alike or alike(stem.numbers[None])


def test_a_force_is_computed_once_and_the_oldest_is_replaced():
    """Forces of the same coordinates share a row, and those in use keep theirs."""
    op, start = np.linspace(40.0, 60.0, 50), np.zeros(50, dtype=np.uint8)
    start[0] = 1
    forces = Forces.none_yet(op, start, 1.0, rows=3)
    shaping = evaluator().layout(hypothesis("actuator_lag")).shaping
    item, two, three, four = ([0.1, tau] for tau in (1.0, 2.0, 3.0, 4.0))
    first = forces.of([(shaping, np.array([item, two, item, three]))])
    assert first.tolist() == [0, 1, 0, 2]
    expected = forces.rows[1].copy()
    then = forces.of([(shaping, np.array([two, four]))])
    assert then.tolist() == [1, 0]  # the row of the oldest that is not requested now
    np.testing.assert_array_equal(forces.rows[1], expected)
    fresh = Forces.none_yet(op, start, 1.0, rows=1)
    fresh.of([(shaping, np.array([four]))])
    np.testing.assert_array_equal(forces.rows[0], fresh.rows[0])
