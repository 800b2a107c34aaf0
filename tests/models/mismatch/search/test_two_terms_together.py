"""Two hypotheses put together as a start, and what a second term needs beside the first."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch.acceptance_limits import BESIDE_ANOTHER, convincing, strength
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_fit import fit_base
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import GLANCE, scored
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import problem_of, summary_of
from stemwatch.models.mismatch.search.named_terms import SelectionStage, beside_another
from stemwatch.models.mismatch.search.other_coordinates import SHARES, carried_over, put_together
from stemwatch.models.mismatch.search.term_scores import put_beside, screened
from stemwatch.models.mismatch.search.term_selection import _sticking_again
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.stickslip.advantage import Advantage
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


def test_a_lag_is_found_beside_a_delay_that_has_taken_its_part():
    """On top of the delay as it was fitted alone, a lag gains less than where both are put
    together; what is not found again keeps its score."""
    base = based(simulated_by_chain(samples=1200, dead_time=3.0, actuator_lag=2.5))
    evaluator, terms = base.evaluator, catalogue()
    both = [terms["dead_time"], terms["actuator_lag"]]
    alone = conclude(evaluator, screened(evaluator, base.fitted, both))
    (late,) = (score.fitted for score in alone if score.slug == "dead_time")
    more = [terms["actuator_lag"], terms["lost_motion"]]
    on_top = conclude(evaluator, screened(evaluator, late, more, GLANCE))
    beside = conclude(evaluator, put_beside(evaluator, late, on_top, alone))
    before, after = ({score.slug: score for score in scores} for scores in (on_top, beside))
    assert after["lost_motion"] is before["lost_motion"]
    lag, shorter = after["actuator_lag"], after["actuator_lag"].fitted.values("dead_time").mean()
    assert lag.advantage.mean >= before["actuator_lag"].advantage.mean
    assert lag.values[0] == pytest.approx(2.5, rel=0.2)
    assert shorter == pytest.approx(3.0, rel=0.2)
    assert shorter < 0.8 * late.values("dead_time").mean()


def test_beside_a_term_that_was_accepted_a_second_needs_less(of_two):
    """Not beside one that was taken as a guess, no third one, and neither play nor dwell."""
    first = SelectionStage(of_two.fitted, (), ())
    guess = SelectionStage(of_two.fitted, (), (), promising=True)
    assert beside_another([first])
    assert not any(map(beside_another, ([], [guess], [first, first])))
    counts = np.full(40, 90.0)
    at_limit = Advantage(0.095, 1.4)
    of_lag = strength(at_limit, counts, "actuator_lag", 1)
    assert BESIDE_ANOTHER < of_lag < 1.0
    assert convincing(at_limit, counts, "actuator_lag", 1, beside=True)
    assert not convincing(at_limit, counts, "actuator_lag", 1)
    assert not convincing(at_limit, counts, "lost_motion", 1, beside=True)


def test_beside_a_top_speed_a_stem_is_seen_to_stick_again():
    """A descent from a stem that slides does not find it."""
    sticking = {base_coordinate.RESTICK: 0.5}
    recording = simulated_by_chain(samples=1200, base=sticking, rate_limit=1.5)
    evaluator = based(recording).evaluator
    sliding = at(evaluator, rate_limit=1.5)
    again = conclude(evaluator, _sticking_again(evaluator, sliding))
    assert again.candidates[:, base_coordinate.RESTICK].mean() == pytest.approx(0.5, abs=0.3)
