"""The mismatch reaches the screening: its numbers, its verdict and its sentences."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.recording import Role
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator.hidden import draw_effect, draw_nulls
from stemwatch.models.verdict import Verdict
from tests.models.mismatch.fitted_chain import rescaled, simulated_by_chain

QUICK = Options(narx=False)
BLIND = Options(narx=False, mismatch=False)


@cache
def simulated(slug, seed):
    """A recording and the valve that made it."""
    case = draw_nulls(1, seed)[0] if slug == "null" else draw_effect(slug, 1, seed)[0]
    return case.simulated().recording, case.loop.valve


@cache
def screened(slug, seed, options=QUICK):
    """Its screening without networks."""
    return screen([Case(recording=simulated(slug, seed)[0])], options)[0]


def numbers(answer):
    """S, J and their intervals."""
    return [(item.value, item.low, item.high) for item in (answer.S, answer.J)]


@pytest.mark.parametrize(
    ("slug", "seed"),
    [pytest.param("dead_time", 4016, marks=pytest.mark.long), ("travel_stop", 4001)],
)
def test_where_something_was_named_the_restated_numbers_are_reported(slug, seed):
    """S and J of the screening are the restated ones, nearer to the valve than the naive ones."""
    result, (_, valve) = screened(slug, seed), simulated(slug, seed)
    left_out = result.mismatch
    assert slug in left_out.effects[0].members
    assert numbers(result) == numbers(left_out.restated)
    naive, restated = left_out.naive.S.value, left_out.restated.S.value
    assert naive > 1.1 * valve.S
    assert abs(restated - valve.S) < 0.25 * abs(naive - valve.S)
    assert result.S.low <= result.S.value <= result.S.high


@pytest.mark.parametrize(
    ("S", "J", "terms", "without_names"),
    [
        (0.3, 0.1, {"supply_sag": [-0.2, 30.0]}, Verdict.WATCH),
        (0.4, 0.1, {"growing_stiction": [2.0]}, Verdict.WATCH),
        (0.6, 0.2, {"growing_stiction": [1.5]}, Verdict.WATCH),
    ],
)
def test_the_restated_numbers_drive_the_verdict(S, J, terms, without_names):
    """A valve with little friction is not watched because of the hidden physics."""
    recording = simulated_by_chain(S, J, samples=1200, **terms)
    (result,), (blind,) = (screen([Case(recording=recording)], how) for how in (QUICK, BLIND))
    assert [*terms] == [effect.slug for effect in result.mismatch.effects]
    assert without_names is blind.verdict
    assert Verdict.HEALTHY is result.verdict
    assert result.S.value == pytest.approx(S, abs=0.1)
    assert blind.S.value > 1.5 * S


@pytest.mark.long
def test_where_nothing_was_named_the_likelihood_tells_S_and_J():
    """A null has those of the whole record, near those of the stick-slip fit and of the valve."""
    result, blind = screened("null", 4001), screened("null", 4001, BLIND)
    _, valve = simulated("null", 4001)
    assert Finding.NONE is result.mismatch.finding
    assert result.mismatch.restated.by_likelihood
    assert numbers(result) == numbers(result.mismatch.restated)
    assert blind.S.low < result.S.value < blind.S.high
    assert result.S.value == pytest.approx(valve.S_read, abs=0.1)
    assert result.S.low < valve.S_read < result.S.high
    assert result.verdict == blind.verdict


def test_switched_off_there_is_no_mismatch():
    """Without the mismatch the screening uses the stick-slip fit alone."""
    blind = screened("travel_stop", 4001, BLIND)
    assert None is blind.mismatch
    assert blind.S.value != screened("travel_stop", 4001).S.value


def test_the_reason_names_the_hidden_effect_and_the_naive_S():
    """The verdict's sentence names the physics in words, and the naive S where it misleads."""
    result = screened("travel_stop", 4001)
    answer = result.reason + result.advice
    assert result.mismatch.effects[0].sentence in answer
    naive = result.mismatch.naive.S.value
    assert f"S and J alone would have read S as {naive:.1f} %" in answer


@pytest.mark.long
def test_the_screening_explains_the_recording_as_it_was_read():
    """Its mismatch is that of ``explain`` on the same recording."""
    direct = explain(simulated("travel_stop", 4001)[0])
    carried = screened("travel_stop", 4001).mismatch
    alike = {"runs": None, "seconds": 0.0}
    assert replace(carried, **alike) == replace(direct, **alike)
    np.testing.assert_array_equal(carried.runs.extended, direct.runs.extended)


def test_what_cannot_be_fitted_has_no_mismatch_and_a_reason():
    """No position, and a position that never moves: undetermined, each with its own sentence."""
    recording = simulated_by_chain(samples=900)
    blind = replace(
        recording,
        signals={role: item for role, item in recording.signals.items() if role is not Role.MV},
    )
    stuck = rescaled(recording, np.full(900, 47.0))
    for item in screen([Case(recording=blind), Case(recording=stuck)], QUICK):
        assert Verdict.UNDETERMINED is item.verdict
        assert None is item.mismatch
        assert item.reason
        assert item.S.reason
