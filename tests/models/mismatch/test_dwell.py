"""Dwell is found from a hundred breakaways where no trajectory shows it, and scatter is not
dwell.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.batched_search import conclude
from stemwatch.models.mismatch.crossfit import scored
from stemwatch.models.mismatch.dwell import LEAST_Z, LEAST_Z_BESIDE_SPEED, dwelling, refit_with_rise
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.mismatch.term_selection import neutral
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.studies.simulator.defects import PackingDefects
from stemwatch.models.studies.simulator.hidden import draw_effect, draw_nulls, simulate_hidden
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)

DWELL = "dwell_dependent_breakaway"
PLACE = 12  # of a valve whose packing is made of bristles


def base_of(recording, S=4.0, J=1.2):
    """The evaluator of a recording, and S and J alone on both folds."""
    evaluator = evaluator_of(recording)
    layout = evaluator.layout(hypothesis())
    row = candidate(layout, S, J)
    return evaluator, conclude(evaluator, scored(layout, np.vstack((row, row))))


@cache
def simulated(place):
    """A valve of the plant with hidden dwell: the recording, S, J, and the rise."""
    case, run = simulate_hidden(draw_effect(DWELL, place + 1, 4021)[place])
    return run.recording, run.truth.S, run.truth.J, case.sizes[f"{DWELL}.percent"]


@pytest.mark.parametrize("rise", [0.2, 0.4])
def test_the_rise_of_the_breakaways_is_seen(rise):
    """A stem that the fitted chain made: a slope over the rests, and no steeper than the rise.

    Between two samples of a quick ramp the force is not known, which flattens the slope.
    """
    evaluator, result = base_of(
        simulated_by_chain(samples=7200, dwell_dependent_breakaway=[rise]), S=4.4, J=1.6
    )
    seen = dwelling(evaluator, result)
    assert seen is not None
    assert seen.z >= LEAST_Z
    assert 0.25 * rise < seen.rise < 1.2 * rise


def test_without_dwell_there_is_none():
    """Breakaways at one level have no slope."""
    seen = dwelling(*base_of(simulated_by_chain(samples=7200)))
    assert seen is None or not seen.convincing


def test_bristles_that_let_go_early_under_a_quick_force_are_no_dwell():
    """A slow force means a long rest, so that their breakaways rise with the rest as well."""
    case = draw_nulls(PLACE + 1, 5151, "routine")[PLACE]
    bristles = PackingDefects(presliding_percent=0.002)
    loop = replace(case.loop, valve=replace(case.loop.valve, packing=bristles))
    recording = simulate_loop(loop, case.seed).recording
    seen = dwelling(*base_of(recording, S=4.4, J=2.3))
    assert seen is not None
    assert seen.z >= LEAST_Z
    assert seen.z_beside_speed < LEAST_Z_BESIDE_SPEED
    assert not seen.convincing


def test_fewer_than_ten_breakaways_give_no_dwell():
    """Fewer than ten events are no regression."""
    assert dwelling(*base_of(simulated_by_chain(samples=120))) is None


def test_the_refit_holds_the_rise_and_gives_back_s_and_j():
    """The rise from the breakaways stays in the model; S and J shrink by the part that belongs to
    it.
    """
    evaluator, result = base_of(
        simulated_by_chain(samples=7200, dwell_dependent_breakaway=[0.4]), S=4.8, J=2.0
    )
    seen = dwelling(evaluator, result)
    assert seen is not None
    conclusion = conclude(
        evaluator, neutral(evaluator, result, hypothesis().plus(catalogue()[DWELL]))
    )
    fitted = refit_with_rise(evaluator, conclusion, seen)
    values = fitted.values(DWELL)
    assert np.all(np.abs(values - seen.rise) <= 2.0 * seen.error + 1e-9)
    assert np.all(fitted.candidates[:, 0] < 4.8)


@pytest.mark.parametrize("place", [2, pytest.param(3, marks=pytest.mark.long)])
def test_hidden_dwell_is_named_with_its_events(place):
    """On a valve of the plant: named, with the evidence of the breakaways, S and J nearer."""
    recording, S, J, rise = simulated(place)
    explanation = explain(recording)
    (item,) = explanation.effects
    assert DWELL == item.slug
    assert item.evidence.events_z >= LEAST_Z
    assert "breakaways together" in item.evidence.note
    assert item.parameters["b"].low <= item.parameters["b"].value <= item.parameters["b"].high
    assert item.parameters["b"].value == pytest.approx(rise, rel=0.6)
    restated = abs(explanation.restated.S.value - S) + abs(explanation.restated.J.value - J)
    assert restated < 0.12 * (S + J)


def test_dwell_that_does_not_improve_unseen_samples_is_reported_but_not_named():
    """The breakaways show it, but the free run does not improve: the disagreement is reported."""
    explanation = explain(simulated(0)[0])
    assert Finding.UNKNOWN is explanation.finding
    assert () == explanation.effects
    assert "Dwell dependent breakaway would explain" in explanation.sentence
    assert explanation.restated == explanation.naive


@pytest.mark.parametrize("place", [1, pytest.param(7, marks=pytest.mark.long)])
def test_scatter_is_not_dwell(place):
    """With 12 % scatter a late breakaway has rested longer, but that is not dwell."""
    _, run = simulate_hidden(draw_nulls(place + 1, 4022)[place])
    assert not explain(run.recording).effects
