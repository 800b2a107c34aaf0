"""Two hypotheses put together as a start, and terms that were found first exchanged for better
ones."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch import evaluator as base_coordinate
from stemwatch.models.mismatch.base_fit import fit_base
from stemwatch.models.mismatch.batched_search import conclude
from stemwatch.models.mismatch.crossfit import gain, scored
from stemwatch.models.mismatch.other_coordinates import SHARES, carried_over, put_together
from stemwatch.models.mismatch.prepared_recording import problem_of, summary_of
from stemwatch.models.mismatch.record_effects import measured_record
from stemwatch.models.mismatch.term_selection import (
    SelectionStage,
    _exchanged,
    _settled,
    screened,
)
from stemwatch.models.mismatch.terms import catalogue
from tests.models.mismatch.fitted_chain import candidate, hypothesis, simulated_by_chain

PAIR = {"dead_time": 3.0, "rate_limit": 1.5}


def based(recording):
    """The base fit of a recording."""
    problem = problem_of(recording, measured_record(recording))
    return fit_base(problem, summary_of(problem, problem.interval_s))


@pytest.fixture(scope="module")
def of_two():
    """The base fit of a valve with a delay and a top speed."""
    return based(simulated_by_chain(samples=1200, **PAIR))


def at(evaluator, **terms):
    """A hypothesis on both folds with the terms at given sizes."""
    layout = evaluator.layout(hypothesis(*terms))
    both = np.tile(candidate(layout, **terms), (2, 1))
    return conclude(evaluator, scored(layout, both))


def test_two_hypotheses_are_put_together_at_full_and_half_size(of_two):
    """With S, J and the reading of the one and of the other."""
    evaluator = of_two.evaluator
    late, slow = at(evaluator, dead_time=3.0), at(evaluator, rate_limit=1.5)
    late.candidates[:, base_coordinate.S_PERCENT] = 5.0
    layout = evaluator.layout(hypothesis("dead_time", "rate_limit"))
    starts = put_together(layout, late, slow)
    assert starts.shape == (2, 2 * len(SHARES), layout.size)
    sizes = starts[:, :, [layout.places[slug].start for slug in PAIR]] / [3.0, 1.5]
    np.testing.assert_allclose(sizes[0], [*SHARES, *SHARES])
    S = starts[1, :, base_coordinate.S_PERCENT]
    np.testing.assert_allclose(S, [5.0] * len(SHARES) + [4.0] * len(SHARES))


def test_a_delay_of_the_base_becomes_the_dead_time(of_two):
    """And comes back where the dead time goes."""
    evaluator = of_two.evaluator
    simple = at(evaluator)
    simple.candidates[:, base_coordinate.DELAY] = 0.4
    layout = evaluator.layout(hypothesis("dead_time"))
    rich = carried_over(simple, layout)
    np.testing.assert_allclose(rich[:, layout.places["dead_time"]], 0.4)


def test_a_lag_that_stood_in_for_a_delay_is_exchanged_for_it(of_two):
    """The lag was found first, the top speed on top of it; with the delay in its place unseen
    blocks are predicted clearly better."""
    evaluator, terms = of_two.evaluator, catalogue()
    scores = conclude(
        evaluator,
        screened(evaluator, of_two.fitted, [terms["actuator_lag"], terms["dead_time"]]),
    )
    (lag,) = (score for score in scores if score.slug == "actuator_lag")
    on_top = conclude(evaluator, screened(evaluator, lag.fitted, [terms["rate_limit"]]))
    stages = [
        SelectionStage(of_two.fitted, tuple(scores), (lag,)),
        SelectionStage(lag.fitted, tuple(on_top), tuple(on_top)),
    ]
    wrong = on_top[0].fitted
    right, exchanged = _exchanged(evaluator, wrong, stages)
    assert set(right.slugs) == set(PAIR)
    assert [stage.accepted[0].slug for stage in exchanged] == list(PAIR)
    assert gain(evaluator, wrong, right).t > 1.5
    again, same = _exchanged(evaluator, right, exchanged)
    assert (again, same) == (right, exchanged)


def test_beside_a_top_speed_a_stem_is_seen_to_stick_again():
    """A descent from a stem that slides does not find it."""
    sticking = {base_coordinate.RESTICK: 0.5}
    recording = simulated_by_chain(samples=1200, base=sticking, rate_limit=1.5)
    evaluator = based(recording).evaluator
    sliding = at(evaluator, rate_limit=1.5)
    settled = conclude(evaluator, _settled(evaluator, sliding))
    assert settled.candidates[:, base_coordinate.RESTICK].mean() == pytest.approx(0.5, abs=0.3)
