"""Dwell that only the likelihood of the whole record shows; and what must not be taken for it."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.fit.base_coordinate import S_and_J
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import scored
from stemwatch.models.mismatch.likelihood.maximum_likelihood import RecordLikelihood
from stemwatch.models.mismatch.search import dwell_by_likelihood
from stemwatch.models.mismatch.search.breakaway_levels import DWELL
from stemwatch.models.mismatch.search.dwell_by_likelihood import (
    LEAST_GAIN,
    WORTH,
    compared_with_dwell,
    shows_dwell,
    with_quick_loading,
)
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.studies.simulator.hidden import draw_hidden, draw_nulls
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)


def compared(recording, S, J, least=LEAST_GAIN):
    """The record without and with dwell, begun at S and J alone; and whether dwell passes."""
    evaluator = evaluator_of(recording)
    row = candidate(evaluator.layout(hypothesis()), S, J)
    layout = evaluator.layout(hypothesis())
    fitted = conclude(evaluator, scored(layout, np.vstack((row, row))))
    likelihood = RecordLikelihood(evaluator)
    one = compared_with_dwell(likelihood, fitted, catalogue()[DWELL], least)
    return one, shows_dwell(likelihood, one)


def test_dwell_in_noise_gives_back_s_and_j():
    """Begun from the level after the usual rest, S and J become those before any rest."""
    recording = simulated_by_chain(noise=0.3, samples=3600, dwell_dependent_breakaway=[0.4])
    one, shown = compared(recording, 4.6, 1.8)
    assert shown
    S, J = S_and_J(one.rich.candidate)
    assert abs(S - 4.0) + abs(J - 1.2) < 0.5
    assert one.rich.candidate[one.rich.layout.places[DWELL]][0] == pytest.approx(0.4, rel=0.4)


@pytest.mark.parametrize("place", [32, pytest.param(53, marks=pytest.mark.long)])
def test_a_level_that_was_found_too_low_is_no_dwell(place):
    """On two valves with nothing hidden S and J alone end at a J of about a third of the true one,
    and long rests hold more than that. Begun from many levels, they end at the true ones."""
    case = draw_nulls(place + 1, 4063)[place]
    valve = case.loop.valve
    begun = 0.78 * valve.S_read, 0.35 * valve.J_read
    one, shown = compared(case.simulated().recording, *begun, least=-np.inf)
    assert not shown
    assert one.evidence.gain < LEAST_GAIN
    assert S_and_J(one.simple.candidate) == pytest.approx((valve.S_read, valve.J_read), rel=0.1)


def test_dwell_that_gains_little_at_a_look_is_not_searched(monkeypatch):
    """Nothing is hidden. Begun at the true S and J, nothing is searched; begun at too low a level,
    which long rests exceed, the record without dwell alone."""
    recording = simulated_by_chain(samples=3600)
    monkeypatch.setattr(dwell_by_likelihood, "_searched_in_turn", None)  # a call is a TypeError
    one, shown = compared(recording, 3.2, 0.4)
    assert not shown
    assert one.evidence.gain < WORTH * LEAST_GAIN
    monkeypatch.setattr(dwell_by_likelihood, "_searched", None)
    one, shown = compared(recording, 4.0, 1.2)
    assert not shown
    assert one.evidence.gain < WORTH * LEAST_GAIN


@pytest.mark.parametrize(
    ("seed", "place"), [(4090, 22), pytest.param(2124, 22, marks=pytest.mark.long)]
)
def test_dwell_behind_an_archive_that_draws_lines_is_named(seed, place):
    """No moment of a breakaway is known there. S comes nearer to the true one."""
    case = draw_hidden(place + 1, seed)[place]
    run = case.simulated()
    mismatch = explain(run.recording)
    (effect,) = mismatch.effects
    assert effect.members == (DWELL,)
    assert effect.evidence.likelihood_gain >= LEAST_GAIN
    assert effect.evidence.strength >= 1.0
    assert mismatch.restated.S.value == pytest.approx(case.loop.valve.S_read, rel=0.15)


@pytest.mark.long
@pytest.mark.parametrize(("seed", "place"), [(4063, 78), (4063, 84)])
def test_what_breakaways_or_likelihood_contradict_is_not_named(seed, place):
    """Nothing is hidden. A record that a single moment makes unlikely seems to show dwell, but its
    breakaways show none."""
    run = draw_nulls(place + 1, seed)[place].simulated()
    assert not explain(run.recording).effects


@pytest.mark.parametrize(
    ("seed", "place"),
    [(2135, 6), *(pytest.param(2136, place, marks=pytest.mark.long) for place in (319, 353))],
)
def test_a_packing_that_lets_go_sooner_when_it_is_loaded_quickly_is_no_dwell(seed, place):
    """Nothing is hidden, but quick moves start the stem sooner than slow ones after long rests. The
    likelihood, trajectories or breakaways have proposed dwell."""
    run = draw_hidden(place + 1, seed)[place].simulated()
    assert not explain(run.recording).effects


@pytest.mark.long
def test_what_such_a_packing_does_is_not_named_beside_another_effect():
    """Beside a creep and beside a sag, each the right name."""
    for seed, place, slug in ((2136, 198, "stem_creep"), (2135, 229, "supply_sag")):
        case = draw_hidden(place + 1, seed)[place]
        named = [effect.slug for effect in explain(case.simulated().recording).effects]
        assert named == [slug]


def test_s_and_j_of_such_a_packing_are_found_beside_its_quick_loading():
    """Without it the record seems to need dwell, and J is less than half of the true one."""
    case = draw_hidden(7, 2135)[6]
    evaluator = evaluator_of(case.simulated().recording)
    layout = evaluator.layout(hypothesis())
    row = candidate(layout, 1.6, 0.8)
    fitted = conclude(evaluator, scored(layout, np.vstack((row, row))))
    likelihood = RecordLikelihood(evaluator)
    one = compared_with_dwell(likelihood, fitted, catalogue()[DWELL], LEAST_GAIN)
    beside = with_quick_loading(likelihood, one)
    assert one.evidence.gain >= LEAST_GAIN
    assert beside.evidence.gain < 2.0
    valve = case.loop.valve
    assert S_and_J(beside.simple.candidate) == pytest.approx((valve.S_read, valve.J_read), rel=0.1)
