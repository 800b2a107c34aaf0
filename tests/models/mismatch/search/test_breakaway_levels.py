"""Dwell and play are found from all breakaways together where no trajectory shows them, and scatter
is neither.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.evidence.describe_effect import Directions, by_events
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import scored
from stemwatch.models.mismatch.search.breakaway_levels import (
    DWELL,
    LEAST_Z,
    PLAY,
    BreakawayEvidence,
    breakaway_evidence,
    refit_with_size,
)
from stemwatch.models.mismatch.search.term_scores import neutral
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.studies.simulator.defects import PackingDefects
from stemwatch.models.studies.simulator.hidden import draw_effect, draw_nulls
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    recorded,
    simulated_by_chain,
)


def base_of(recording, S=4.0, J=1.2):
    """The evaluator of a recording, and S and J alone on both folds."""
    evaluator = evaluator_of(recording)
    layout = evaluator.layout(hypothesis())
    row = candidate(layout, S, J)
    return evaluator, conclude(evaluator, scored(layout, np.vstack((row, row))))


@cache
def simulated(place):
    """A valve of the plant with hidden dwell: the recording, S, J, and the rise."""
    case = draw_effect(DWELL, place + 1, 4021)[place]
    run = case.simulated()
    return run.recording, run.truth.S, run.truth.J, case.sizes[f"{DWELL}.percent"]


def told(recording, slug, S=4.0, J=1.2):
    """What the breakaways of a recording tell of one effect."""
    answers = breakaway_evidence(*base_of(recording, S, J))
    return next((answer for answer in answers if answer.slug == slug), None)


@pytest.mark.parametrize("rise", [0.3, 0.5])
def test_the_rise_of_the_breakaways_is_seen(rise):
    """A stem that the fitted chain made: dwell, of about its size, and no play."""
    recording = simulated_by_chain(samples=7200, dwell_dependent_breakaway=[rise])
    seen, play = (told(recording, slug, S=4.4, J=1.6) for slug in (DWELL, PLAY))
    assert seen is not None
    assert seen.convincing
    assert 0.5 * rise < seen.size < 1.5 * rise
    assert seen.rate_z < LEAST_Z[DWELL]
    assert play is None or not play.convincing


def test_play_is_seen_where_the_stem_turns():
    """After a turn the reading lags the other way: play, of about its size, and no dwell."""
    recording = simulated_by_chain(samples=7200, lost_motion=[0.8])
    seen, dwell = (told(recording, slug, S=4.0, J=0.8) for slug in (PLAY, DWELL))
    assert seen is not None
    assert seen.convincing
    assert 0.4 < seen.size < 1.2
    assert dwell is None or not dwell.convincing


def test_breakaways_at_one_level_tell_neither():
    """Without dwell and play there is no such thing."""
    answers = breakaway_evidence(*base_of(simulated_by_chain(samples=7200)))
    assert not any(answer.convincing for answer in answers)


@pytest.mark.long
@pytest.mark.parametrize(("place", "seed", "S", "J"), [(12, 5151, 4.4, 2.3), (38, 2109, 5.2, 2.5)])
def test_bristles_that_let_go_early_under_a_quick_force_are_no_dwell(place, seed, S, J):
    """A slow force means a long rest, so that their breakaways rise with the rest as well."""
    case = draw_nulls(place + 1, seed, "routine")[place]
    bristles = PackingDefects(presliding_percent=0.002)
    loop = replace(case.loop, valve=replace(case.loop.valve, packing=bristles))
    recording = simulate_loop(loop, case.seed).recording
    seen = told(recording, DWELL, S=S, J=J)
    assert seen is not None
    assert not seen.convincing


def test_rests_that_are_all_about_as_long_tell_no_dwell():
    """In a quick steady cycle a rise with rest cannot be told from one with the command's speed."""
    op = quick_cycle(120)
    evaluator = evaluator_of(recorded(op, op))
    layout = evaluator.layout(hypothesis())
    stem = evaluator.simulate(layout, candidate(layout, 4.0, 1.2))
    noise = 0.02 * np.random.default_rng(4).standard_normal(op.size)
    assert told(recorded(op, stem + noise), DWELL) is None


def quick_cycle(cycles):
    """OP up and down by 7 to 8 %, each way in 14 s."""
    sizes = np.random.default_rng(3).uniform(7.0, 8.0, cycles)
    way = np.repeat((1.0, -1.0), 14)
    return 50.0 + np.cumsum(np.concatenate([size / 14 * way for size in sizes])) - 3.75


def test_few_breakaways_tell_nothing():
    """Two minutes hold fewer than eight."""
    assert breakaway_evidence(*base_of(simulated_by_chain(samples=120))) == []


@pytest.mark.parametrize(
    ("slug", "size", "S", "J"), [(DWELL, 0.4, 4.8, 2.0), (PLAY, 0.8, 4.0, 0.8)]
)
def test_the_refit_holds_the_size_and_gives_back_s_and_j(slug, size, S, J):
    """The size from the breakaways stays in the model; S and J change by what belongs to it."""
    evaluator, result = base_of(simulated_by_chain(samples=7200, **{slug: [size]}), S, J)
    seen = next(item for item in breakaway_evidence(evaluator, result) if item.slug == slug)
    conclusion = conclude(
        evaluator, neutral(evaluator, result, hypothesis().plus(catalogue()[slug]))
    )
    fitted = refit_with_size(evaluator, conclusion, seen)
    assert np.all(np.abs(fitted.values(slug) - seen.size) <= 2.0 * seen.error + 1e-9)
    found_S = fitted.candidates[:, 0].mean()
    found_J = (fitted.candidates[:, 0] * fitted.candidates[:, 1]).mean()
    assert abs(found_S - 4.0) + abs(found_J - 1.2) < 0.6 * (abs(S - 4.0) + abs(J - 1.2))


@pytest.mark.parametrize("place", [0, pytest.param(3, marks=pytest.mark.long)])
def test_hidden_dwell_is_named_with_its_events(place):
    """On a valve of the plant: named, with the evidence of the breakaways, S and J nearer. Where
    they also show what a quick force does, the evidence says that it may be part of it."""
    recording, S, J, rise = simulated(place)
    explanation = explain(recording)
    (item,) = explanation.effects
    assert DWELL == item.slug
    assert item.evidence.events_z >= LEAST_Z[DWELL]
    assert "breakaways together" in item.evidence.note
    assert item.parameters["b"].low <= item.parameters["b"].value <= item.parameters["b"].high
    assert item.parameters["b"].value == pytest.approx(rise, rel=0.6)
    for rate_z, said in ((4.0, True), (1.0, False)):
        seen = BreakawayEvidence(DWELL, size=rise, z=5.0, usual=1.5, events=40, rate_z=rate_z)
        note = by_events(item, seen, catalogue()[DWELL], Directions()).evidence.note
        assert said is ("earlier the quicker OP moves" in note)
    restated = abs(explanation.restated.S.value - S) + abs(explanation.restated.J.value - J)
    assert restated < 0.12 * (S + J)


@pytest.mark.long
def test_dwell_that_does_not_improve_unseen_samples_is_reported_but_not_named():
    """The breakaways show it, but the free run does not improve: the disagreement is reported."""
    explanation = explain(simulated(2)[0])
    assert Finding.UNKNOWN is explanation.finding
    assert () == explanation.effects
    assert "Dwell dependent breakaway would explain" in explanation.sentence
    assert explanation.restated == explanation.naive


@pytest.mark.parametrize("place", [1, pytest.param(7, marks=pytest.mark.long)])
def test_scatter_is_not_dwell(place):
    """With 12 % scatter a late breakaway has rested longer, but that is not dwell."""
    run = draw_nulls(place + 1, 4022)[place].simulated()
    assert not explain(run.recording).effects
