"""The published result of a recording: accepted physics only, and no worse prediction because of
it.
"""

from __future__ import annotations

import numpy as np
import pytest

import stemwatch
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.mismatch.term import RecordingSummary
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator import demo_plant, simulate_loop
from stemwatch.models.studies.simulator.hidden import draw_hidden, draw_nulls
from tests.models.mismatch.fitted_chain import rescaled, simulated_by_chain

LOOK = RecordingSummary(
    interval_s=1.0,
    duration_s=1200.0,
    unit_s=1.0,
    op_low=30.0,
    op_high=70.0,
    mv_low=30.0,
    mv_high=70.0,
    sigma=0.05,
    S=4.0,
    J=1.2,
)


def noisy(recording, size, seed):
    """The recording with noise on its position, percent of span."""
    mv = recording.mv.values
    return rescaled(recording, mv + size * np.random.default_rng(seed).standard_normal(mv.size))


@pytest.mark.parametrize(
    "slug",
    [
        pytest.param(slug, marks=[pytest.mark.long] if place % 8 else [])
        for place, slug in enumerate(sorted(catalogue()))
    ],
)
def test_no_term_is_published_that_predicts_unseen_data_worse(slug):
    """Every term of the catalogue, hidden in a short noisy recording: whatever is then named, the
    free run over the part that was not fitted is at least as near as with S and J alone."""
    starts = catalogue()[slug].starts(LOOK)
    recording = simulated_by_chain(samples=1200, **{slug: starts[starts.shape[0] // 2]})
    explanation = explain(noisy(recording, 0.2, 5))
    if explanation.effects:
        assert explanation.heldout.fit_extended >= explanation.heldout.fit_naive
    assert explanation.heldout.improves
    if explanation.finding is Finding.UNKNOWN:
        assert explanation.restated == explanation.naive
        np.testing.assert_array_equal(explanation.runs.extended, explanation.runs.naive)


@pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2, 3))]
)
def test_an_unrelated_position_is_never_called_explained(seed):
    """A wandering position: either no verdict or unknown, S and J not restated."""
    recording = simulated_by_chain(samples=900)
    steps = np.random.default_rng(seed).standard_normal(900)
    explanation = explain(rescaled(recording, 50.0 + 0.5 * np.cumsum(steps)))
    assert explanation.finding in (Finding.UNKNOWN, Finding.NOT_TESTABLE)
    assert explanation.restated == explanation.naive


@pytest.mark.long
def test_slips_beyond_the_command_are_no_stretched_reading():
    """A positioner lets the stem jump past its command (S 3, J 3.8): no span error is named."""
    loop = next(loop for loop in demo_plant(1) if loop.story == "sticky, overshoot")
    recording = simulate_loop(loop, 6).recording
    assert Role.MV in recording.signals
    explanation = explain(recording.part(0, 3600))
    assert "span_error" not in [effect.slug for effect in explanation.effects]


def test_a_ring_between_a_few_samples_is_no_ringing_positioner():
    """Only the air lag is present; a ring at the limit of the sampling would fit it too."""
    explanation = explain(stemwatch.simulate(S=5.0, J=2.0, minutes=30, seed=3))
    assert "underdamped_positioner" not in [effect.slug for effect in explanation.effects]
    assert explanation.restated.S.value == pytest.approx(5.0, abs=0.3)


@pytest.mark.parametrize("place", [1, pytest.param(9, marks=pytest.mark.long)])
def test_manual_steps_and_ramps_do_not_bias_S(place):
    """Nothing is hidden; breakaways under an operator's steps tell another S than every fit, by a
    third, and are not taken."""
    case = draw_nulls(place + 1, 6161)[place]
    run = case.simulated()
    assert case.concealment == "rich"
    explanation = explain(run.recording)
    assert explanation.finding is Finding.NONE
    assert explanation.restated.S.value == pytest.approx(run.truth.S, rel=0.1)


@pytest.mark.long
@pytest.mark.parametrize("place", [13, 22])
def test_missed_slips_of_a_free_run_are_not_an_unknown_effect(place):
    """In quiet or short records with nothing hidden, the error of a missed slip is not an
    effect.
    """
    run = draw_nulls(place + 1, 6161)[place].simulated()
    explanation = explain(run.recording)
    assert explanation.finding is Finding.NONE
    assert explanation.heldout.fit_extended < 50.0


@pytest.mark.long
def test_a_lag_under_a_stem_that_hardly_jumps_is_found_and_is_no_dwell():
    """A stem that sticks at a turn alone creeps on with a command that only comes near its end."""
    run = draw_hidden(2, 8383)[1].simulated()
    explanation = explain(run.recording)
    assert [effect.slug for effect in explanation.effects] == ["actuator_lag"]
    assert explanation.effects[0].parameters["tau"].value == pytest.approx(2.7, abs=0.3)
    assert explanation.restated.S.value == pytest.approx(run.truth.S, rel=0.03)


@pytest.mark.long
def test_a_wave_of_friction_is_no_lag():
    """More is left than noise, and the likeliest stem is further from the readings than noise."""
    found = explain(draw_hidden(169, 2119)[168].simulated().recording)
    assert found.finding is Finding.UNKNOWN
    assert found.effects == ()


@pytest.mark.long
def test_a_spring_with_hysteresis_is_no_span_error():
    """A line over the stroke once stood for it; it has its own name, and S is near the true one."""
    run = draw_hidden(136, 2119)[135].simulated()
    found = explain(run.recording)
    assert [effect.slug for effect in found.effects] == ["spring_hysteresis"]
    assert found.restated.S.value == pytest.approx(run.truth.S, rel=0.1)
