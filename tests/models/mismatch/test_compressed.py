"""Samples that an archive dropped still bound the model: corridors about interpolated lines, and
their use.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.acceptance_limits import convincing
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.fit.base_fit import base_bounds, first_scatter
from stemwatch.models.mismatch.fit.evaluator import make_evaluator
from stemwatch.models.mismatch.measurement.compression import (
    DOOR_NOISE,
    NARROWEST_DOOR,
    WIDEST_DOOR,
    noise_behind_door,
    swinging_door_deviation,
)
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import prepare, problem_of, summary_of
from stemwatch.models.stickslip import kernel
from stemwatch.models.stickslip.evaluator import CANONICAL
from stemwatch.models.studies.null_scores import null_scores
from stemwatch.models.studies.simulator.historian import swinging_door
from stemwatch.service.studies.robustness import WAYS
from tests.models.mismatch.fitted_chain import candidate, hypothesis, rescaled, simulated_by_chain

DEVIATION = 0.4  # percent


def archived(recording, deviation=DEVIATION):
    """The recording with its position through a swinging door, and what was stored (n,)."""
    mv = recording.mv.values
    stored = swinging_door(mv, deviation)
    index = np.arange(mv.size)
    drawn = np.interp(index, index[stored], mv[stored])
    return rescaled(recording, np.round(drawn, 4)), stored


def evaluator_with_slack(recording):
    """The evaluator of a compressed recording as ``explain`` makes it."""
    measured = measured_record(recording)
    problem = problem_of(recording, measured)
    summary = summary_of(problem, problem.interval_s)
    scatter = first_scatter(summary)
    bounds = base_bounds(problem, summary)
    return make_evaluator(problem, summary, bounds, 0.15, CANONICAL, scatter, measured.slack)


@given(
    deviation=st.floats(0.1, 0.45),
    noise=st.floats(0.02, 0.15),
    seed=st.integers(1, 50),
)
@settings(max_examples=15, deadline=None)
def test_every_dropped_value_lies_in_the_corridor(deviation, noise, seed):
    """The slack is as wide as the archive's deviation where that can be estimated, and never
    absurd.
    """
    true = simulated_by_chain(noise=noise, seed=seed)
    recording, stored = archived(true, deviation)
    result = swinging_door_deviation(recording.mv.values, stored)
    assert NARROWEST_DOOR <= result <= WIDEST_DOOR
    error = np.abs(recording.mv.values - true.mv.values)
    assert np.mean(error > result) < 0.02


@pytest.mark.parametrize("share", [0.5, 0.8, 1.2, 2.0])
def test_noise_gets_through_a_door(share):
    """The share of samples that a door keeps of a stem that jumps and rests tells the noise, which
    the stored points do not show, to a quarter."""
    rng = np.random.default_rng(4090)
    stem = np.repeat(rng.normal(50.0, 5.0, 90), 40)
    stored = swinging_door(stem + share * DEVIATION * rng.normal(size=stem.size), DEVIATION)
    found = noise_behind_door(stored, DEVIATION)
    assert found == pytest.approx(share * DEVIATION, rel=0.25)


def test_little_noise_behind_a_door_is_not_seen():
    """Where hardly anything but the moves is kept, the noise is taken to be its least."""
    rng = np.random.default_rng(4090)
    stem = np.repeat(rng.normal(50.0, 5.0, 90), 40)
    stored = swinging_door(stem + 0.1 * DEVIATION * rng.normal(size=stem.size), DEVIATION)
    assert noise_behind_door(stored, DEVIATION) == DOOR_NOISE * DEVIATION


@pytest.mark.parametrize("step", [0.2, 0.25])
def test_a_door_over_coarse_steps_is_seen(step):
    """Lines of few slopes between stored points that lie on the recorder's steps are an archive's,
    and no stem at its top speed: the noise is at least that of the rounding."""
    recording = simulated_by_chain(noise=0.03)
    rounded = rescaled(recording, step * np.round(recording.mv.values / step))
    drawn, _ = archived(rounded)
    measured = measured_record(rescaled(recording, drawn.mv.values))
    assert {"quantisation", "historian_compression"} <= {one.slug for one in measured.effects}
    assert problem_of(drawn, measured).sigma >= step / np.sqrt(12.0)


def test_only_interpolated_values_have_slack():
    """Stored points are measured, the others are bounded, and a frozen stretch is neither."""
    recording, stored = archived(simulated_by_chain())
    measured = measured_record(recording)
    assert np.array_equal(measured.real, measured.slack == 0.0)
    assert np.mean(measured.real == stored) > 0.97
    mv = recording.mv.values.copy()
    mv[600:900] = mv[600]
    frozen = measured_record(rescaled(recording, mv))
    assert not (frozen.real | (frozen.slack > 0.0))[650:850].any()


def test_what_reports_by_exception_make_themselves_is_not_looked_for():
    """Steps of any stem that slides, and breakaways that are known to the deviation."""
    plain = simulated_by_chain()
    reported = WAYS["exception reporting of 1 %"].change(plain)
    for recording, of_reports in ((plain, False), (reported, True)):
        measured = measured_record(recording)
        refused = prepare(recording, measured, None, problem_of(recording, measured)).refused
        for slug in ("low_speed_restick", "slip_overshoot", "dwell_dependent_breakaway"):
            assert ("reports" in refused.get(slug, "")) == of_reports


def test_a_record_without_lines_has_no_slack():
    """A measured position is scored sample by sample, as ever."""
    assert not measured_record(simulated_by_chain()).slack.any()


def test_the_residual_is_zero_inside_the_corridor_and_counts_from_its_edge():
    """The loss counts the distance from the corridor, and at a stored point the whole residual."""
    evaluator = evaluator_with_slack(archived(simulated_by_chain())[0])
    mv, slack = evaluator.problem.mv, evaluator.slack
    assert not evaluator.residual(mv + 0.99 * slack).any()
    assert evaluator.residual(mv - 2.0 * slack) == pytest.approx(slack)
    measured = evaluator.measured
    assert evaluator.residual(mv - 0.3)[measured] == pytest.approx(0.3)
    assert (
        int(evaluator.measured_counts.sum())
        == np.count_nonzero(measured)
        < 0.5 * evaluator.counts.sum()
    )


def test_the_truth_costs_less_than_a_stem_that_jumps_otherwise():
    """The corridors alone, without the stored points, favour the true J over another one."""
    evaluator = evaluator_with_slack(archived(simulated_by_chain(S=4.0, J=1.6))[0])
    layout = evaluator.layout(hypothesis())
    inside = evaluator.problem.scored & ~evaluator.measured

    def left(J):
        run, _ = evaluator.assimilated(layout, candidate(layout, S=4.0, J=J))
        return float(np.sum(evaluator.residual(run)[inside] ** 2))

    assert left(1.6) < 0.3 * min(left(0.2), left(3.2))


def test_resynchronisation_uses_measured_samples_only():
    """No block of time begins on an interpolated value."""
    evaluator = evaluator_with_slack(archived(simulated_by_chain())[0])
    begins = np.flatnonzero(evaluator.marks == kernel.RESYNC)
    assert begins.size > 5
    assert not evaluator.slack[begins - 1].any()


def test_a_lag_is_named_in_a_compressed_record():
    """Where one sample in ten is stored, a lag of three seconds is still found with its size."""
    explanation = explain(archived(simulated_by_chain(S=4.0, J=1.4, actuator_lag=[3.0]))[0])
    assert any("actuator_lag" in effect.members for effect in explanation.effects)
    assert explanation.restated.S.value == pytest.approx(4.0, abs=0.6)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_compression_alone_names_no_effect(seed):
    """Interpolated lines do not make any term pass its limits."""
    recording, stored = archived(simulated_by_chain(seed=seed))
    assert not explain(recording).effects
    counts = np.bincount(np.flatnonzero(stored) * 20 // stored.size, minlength=20).astype(float)
    result = null_scores(recording).terms
    assert result
    assert not convincing_any(result, counts)


def convincing_any(result, counts):
    """Whether any score (mean, t, strength) would pass the limits of its term."""
    from stemwatch.models.stickslip.advantage import Advantage

    return any(convincing(Advantage(*item[:2]), counts, slug) for slug, item in result.items())
