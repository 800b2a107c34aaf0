"""A spring with hysteresis is not taken for an error of the reading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.mismatch.acceptance.follows_turns import follows_turns, turned
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import CAREFUL, LOOK, crossfit, refit
from stemwatch.models.studies.simulator.hidden import draw_effect
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    rescaled,
    simulated_by_chain,
)


def test_the_share_of_the_inner_friction_by_hand():
    """From 0 it comes within 1/e of its end over one way; a turn begins from where it is."""
    places = np.array([50.0, 56.0, 56.0, 50.0])
    risen = 1.0 - np.exp(-1.0)
    np.testing.assert_allclose(
        turned(places, 6.0), [0.0, risen, risen, (risen + 1.0) * np.exp(-1.0) - 1.0]
    )


def fitted_to(recording):
    """S, J, zero and gain fitted to a recording."""
    evaluator = evaluator_of(recording)
    layout = evaluator.layout(hypothesis())
    start = candidate(layout, base={base_coordinate.GAIN: -0.05})
    fitted = conclude(evaluator, crossfit(evaluator, layout, start[None], LOOK))
    return evaluator, conclude(evaluator, refit(evaluator, fitted, CAREFUL))


@pytest.mark.parametrize("gain", [0.0, -0.06])
def test_a_span_error_leaves_nothing_that_follows_the_turns(gain):
    """With the gain in the model only noise is left."""
    assert not follows_turns(
        *fitted_to(simulated_by_chain(base={base_coordinate.GAIN: gain}, noise=0.1))
    )


def test_a_position_that_trails_behind_each_turn_is_seen():
    """Taken off the reading along the travel, as a spring with inner friction does."""
    plain = simulated_by_chain()
    mv = plain.mv.values - 1.2 * turned(simulated_by_chain(noise=0.0).mv.values, 7.0)
    assert follows_turns(*fitted_to(rescaled(plain, mv)))


def test_as_much_as_an_archive_keeps_open_is_no_spring():
    """The same swing, where the values between the kept ones may lie off by half of it."""
    plain = simulated_by_chain()
    mv = plain.mv.values - 0.6 * turned(simulated_by_chain(noise=0.0).mv.values, 7.0)
    evaluator, fitted = fitted_to(rescaled(plain, mv))
    assert follows_turns(evaluator, fitted)
    kept = np.zeros_like(evaluator.slack)
    kept[1::2] = 0.7
    assert not follows_turns(replace(evaluator, slack=kept), fitted)


@pytest.mark.long
@pytest.mark.parametrize("place", [17, 18])
def test_a_simulated_spring_with_hysteresis_is_no_span_error(place: int) -> None:
    """Both valves were once named a span error; it has its own name, and S is near the true one."""
    case = draw_effect("spring_hysteresis", place + 1, 4060, "routine")[place]
    found = explain(case.simulated().recording)
    assert [effect.members for effect in found.effects] == [("spring_hysteresis",)]
    size = case.sizes["spring_hysteresis.hysteresis_percent"]
    assert found.effects[0].parameters["H"].value == pytest.approx(size, rel=0.35)
    assert found.restated.S.value == pytest.approx(case.loop.valve.S, rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize("place", [17, 18])
def test_without_its_term_the_spring_is_unknown(place: int) -> None:
    """No error of the reading stands in for it."""
    case = draw_effect("spring_hysteresis", place + 1, 4060, "routine")[place]
    recording = case.simulated().recording
    found = explain(recording, refused={"spring_hysteresis": "it is not looked for here"})
    assert found.finding is Finding.UNKNOWN
    assert found.effects == ()
