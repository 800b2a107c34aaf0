"""Two terms are looked for together where one alone came near, and named where each is needed."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from stemwatch.models.mismatch.acceptance_limits import LEAST_OF_A_PAIR, convincing
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.fit.base_fit import fit_base
from stemwatch.models.mismatch.fit.crossfit import gain
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import problem_of, summary_of
from stemwatch.models.mismatch.search import term_pairs
from stemwatch.models.mismatch.search.named_terms import SelectionStage, TermScore
from stemwatch.models.mismatch.search.term_pairs import best_pairs, with_pair
from stemwatch.models.mismatch.search.term_selection import name_terms
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.stickslip.advantage import Advantage
from stemwatch.models.studies.simulator.hidden import draw_hidden
from tests.models.mismatch.fitted_chain import simulated_by_chain

TERMS = [term for term in catalogue().values() if not term.in_base]
PAIR = {"dead_time": 3.0, "lost_motion": 0.8}


@pytest.fixture(scope="module")
def one_of_two():
    """The result for two effects when the second was not searched for: the first alone."""
    recording = simulated_by_chain(samples=1200, **PAIR)
    problem = problem_of(recording, measured_record(recording))
    selection = name_terms(fit_base(problem, summary_of(problem, problem.interval_s)), TERMS)
    (needed,) = [item for item in selection.needed if item.term.slug == "dead_time"]
    stages = selection.stages[:2]
    return replace(selection, fitted=stages[1].before, needed=(needed,), stages=stages)


@pytest.mark.long
def test_the_second_of_two_is_found_with_the_first(one_of_two):
    """Both are named, each against the best fit of the other alone, and the scores are kept."""
    pair = with_pair(one_of_two, TERMS)
    assert {item.term.slug for item in pair.needed} == set(PAIR) == set(pair.fitted.slugs)
    assert len(one_of_two.stages) + 2 == len(pair.stages)
    for item in pair.needed:
        assert item.of_pair
        assert item.members[0] == item.term.slug
        (left,) = item.without.slugs
        assert left != item.term.slug
        again = gain(pair.evaluator, item.without, pair.fitted)
        assert (item.advantage.mean, item.advantage.t) == (again.mean, again.t)
        np.testing.assert_allclose(
            pair.fitted.values(item.term.slug).mean(), PAIR[item.term.slug], rtol=0.1
        )


def test_no_pair_is_searched_where_no_second_term_came_near(one_of_two, monkeypatch):
    """One effect explains the recording: no pair is searched, and nothing changes."""
    far = [
        TermScore(score.term, score.fitted, Advantage(0.001, 0.1))
        for score in one_of_two.stages[1].scores
    ]
    first, last = one_of_two.stages
    quiet = replace(one_of_two, stages=(first, SelectionStage(last.before, tuple(far), ())))
    monkeypatch.setattr(term_pairs, "best_pairs", None)  # a call would end in a TypeError
    assert with_pair(quiet, TERMS) is quiet
    two = replace(one_of_two, needed=one_of_two.needed * 2)
    assert with_pair(two, TERMS) is two


@pytest.mark.long
def test_a_pair_is_named_beyond_the_limit_of_pairs_alone(one_of_two, monkeypatch):
    """The weaker of the two must reach more than pairs do where nothing is hidden; a single later
    term needs less.
    """
    best = best_pairs(one_of_two, TERMS)[0]
    told = one_of_two.evaluator.measured_counts
    assert all(convincing(score.advantage, told, score.slug, 1) for score in best.scores)
    assert best.needs_both(one_of_two.evaluator)
    above = best.least_strength(one_of_two.evaluator) + 0.01
    assert above > LEAST_OF_A_PAIR > 1.0
    monkeypatch.setattr(term_pairs, "LEAST_OF_A_PAIR", above)
    assert with_pair(one_of_two, TERMS) is one_of_two


def _pair(*slugs):
    return SimpleNamespace(
        slugs=slugs,
        scores=[SimpleNamespace(slug=slug, term=catalogue()[slug]) for slug in slugs],
        fitted=slugs,
    )


def test_of_pairs_as_good_the_simpler_one_is_taken(monkeypatch):
    """An asymmetric lag beside play is no more than a lag beside play that does nearly as well."""
    monkeypatch.setattr(term_pairs, "gain", lambda *_: Advantage(0.01, 0.5))
    rich = _pair("asymmetric_lag", "lost_motion")
    simple = _pair("actuator_lag", "lost_motion")
    other = _pair("actuator_lag", "stem_creep")
    assert term_pairs._simplest(None, [rich, other, simple]) is simple
    assert term_pairs._simplest(None, [simple, rich]) is simple
    monkeypatch.setattr(term_pairs, "gain", lambda *_: Advantage(0.2, 3.0))
    assert term_pairs._simplest(None, [rich, simple]) is rich


def test_a_rival_of_one_of_the_pair_is_kept_beside_it(monkeypatch):
    """A rival of one of the two shares the other, and is not clearly worse."""
    monkeypatch.setattr(term_pairs, "gain", lambda *_: Advantage(0.01, 0.5))
    best = _pair("actuator_lag", "lost_motion")
    pairs = [best, _pair("dead_time", "lost_motion"), _pair("dead_time", "stem_creep")]
    lag, play = best.scores
    assert ["dead_time"] == [s.slug for s in term_pairs._rivals(None, pairs, best, lag)]
    assert [] == term_pairs._rivals(None, pairs, best, play)


@pytest.mark.long
@pytest.mark.parametrize(("seed", "index"), [(5151, 17), (5151, 71)])
def test_two_effects_that_gain_nothing_alone_are_both_named(seed, index):
    """Cases of development seeds, of which no term alone passes the limits. S comes within 0.7 %,
    or three times as near as that of S and J alone, and its interval holds the truth."""
    case = draw_hidden(index + 1, seed)[index]
    run = case.simulated()
    explanation = explain(run.recording)
    assert {effect.slug for effect in explanation.effects} == set(case.hidden)
    assert explanation.heldout.improves
    S = explanation.restated.S
    assert S.low <= run.truth.S <= S.high
    naive_error = abs(explanation.naive.S.value - run.truth.S)
    assert S.value == pytest.approx(run.truth.S, abs=max(0.7, naive_error / 3.0))
