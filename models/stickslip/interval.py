"""Intervals of S and J: from the breakaways where there are enough, else by the block bootstrap
(``models.statistics.block_bootstrap``), which never refits.

The cloud of candidates around the optimum is drawn anew a few times, each time where the draws
before it ended. Blocks are long against a slip, so autocorrelated residuals do not make the
interval too narrow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Floats
from stemwatch.models.signals.excitation import reversals
from stemwatch.models.statistics.block_bootstrap import COVERAGE, block_weights, cheapest
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.breakaways import LEAST_J
from stemwatch.models.stickslip.fit import StickSlipFit
from stemwatch.models.stickslip.hypotheses import BOTH, STICKING
from stemwatch.models.stickslip.problem import FitProblem

REPLICATES = 300
CLOUD = 400
ROUNDS = 4
# Real stems are not two-level elements: breakaways scatter, slips overshoot, air lags. MODEL_ERROR
# is the standard deviation of the resulting error of S and of J, as a share of the breakaway level
# (S + J)/2. Calibrated on 120 simulated sticking valves of the force-balance plant (draw_sticky,
# seed 11); `stemwatch trial` prints how often the intervals hold on other seeds.
MODEL_ERROR = 0.08
# Where a lag of a sample or more was fitted, and S is nearly that of friction alone, there may be
# no lag: S of five of 47 valves of draw_sticky (seeds 5151, 7171, 8383) with such a lag was 0.3 to
# 0.8 % too small.
SHARE_ALONE, ALIKE = 0.1, 1.35
# percent; a lag and a narrow dead band can replace each other by about this much
LEAST_ERROR_PERCENT = 0.1


@dataclass(frozen=True)
class StickSlipSample:
    """Bootstrap draws of S and J, (REPLICATES,) each, in percent of OP span."""

    S: Floats
    J: Floats


def interval(draws: Floats, value: float) -> tuple[float, float]:
    """95 % percentile interval of ``draws``, widened to hold ``value``."""
    (both,) = intervals(draws[None, :], np.array([value]))
    return both


def intervals(draws: Floats, values: Floats) -> list[tuple[float, float]]:
    """``interval`` of each row of ``draws`` (k, n), with its own of ``values`` (k,)."""
    low, high = np.percentile(draws, COVERAGE, axis=1)
    return [
        (min(float(below), float(value)), max(float(above), float(value)))
        for below, above, value in zip(low, high, values, strict=True)
    ]


def spread_of(estimate: Estimate) -> Floats:
    """(REPLICATES,) values that have the estimate's 95 % interval: normal quantiles about it."""
    if estimate.value is None or estimate.low is None or estimate.high is None:
        return np.empty(0)
    quantiles = ndtri((np.arange(REPLICATES) + 0.5) / REPLICATES)
    error_below, error_above = estimate.value - estimate.low, estimate.high - estimate.value
    return np.asarray(
        estimate.value + quantiles / 1.96 * np.where(quantiles < 0, error_below, error_above)
    )


def bootstrap(fit: StickSlipFit, *, peaks_kept: bool = True) -> StickSlipSample:
    """Draw S and J from the distribution that the breakaways, or else the recording's blocks of
    time, give. Seeded. ``peaks_kept``: the archive lost nothing that is restored afterwards.
    """
    rng = np.random.default_rng(7)
    if fit.breakaways is not None:
        return _with_friction_alone(StickSlipSample(*fit.breakaways.draws(REPLICATES, rng)), fit)
    evaluator = fit.evaluator
    free = BOTH.free if fit.hypothesis == "both" else STICKING.free
    width = evaluator.spread(free, 0.03)
    smallest = evaluator.spread(free, 1e-4)
    draws = fit.candidate[None, :]
    for _ in range(ROUNDS):
        centre = draws[rng.integers(draws.shape[0], size=CLOUD)]
        cloud = centre + width * rng.standard_normal(centre.shape)
        cloud = evaluator.bounds.clip(np.vstack((fit.candidate, draws, cloud)))
        losses, counts = evaluator.block_losses(cloud)
        draws = cheapest(cloud, losses, block_weights(counts, REPLICATES, rng), rng)
        # Kernel smoothing of the draws, so that the next cloud fills the space between them.
        spread = np.asarray(draws.std(axis=0))
        width = np.where(width > 0, np.maximum(0.5 * spread, smallest), 0.0)
    S = draws[:, coordinate.S_PERCENT]
    J = S * draws[:, coordinate.RATIO]
    if fit.in_steps:
        S, J = with_jumps_of_steps(S, J, way_in_a_sample(fit.evaluator.problem))
    elif fit.J < LEAST_J:
        within_sample = way_in_a_sample(fit.evaluator.problem) if peaks_kept else 0.0
        largest = max(LEAST_J if fit.unneeded is None else fit.unneeded.J, LEAST_J, within_sample)
        raised = with_untold_jumps(S, J, largest)
        if within_sample > LEAST_J:
            # The stem is dragged (S - J)/2 behind its command, which the recording does show; a
            # jump that is not seen is half of it in the level that was fitted.
            S = S + 0.5 * (raised - J)
        J = raised
    step = _command_step(fit)
    error = max(MODEL_ERROR * 0.5 * (fit.S + fit.J), LEAST_ERROR_PERCENT)
    return StickSlipSample(S=_blur(S, step, error, rng), J=_blur(J, step, error, rng))


def with_untold_jumps(S: Floats, J: Floats, largest: float = LEAST_J) -> Floats:
    """Draws of J (m,) raised to anything up to the ``largest`` jump that is not told, percent, and
    to no more than their ``S`` (m,).

    No fit tells a small jump from a stem that creeps with its command, and the jumps that are seen
    may be either.
    """
    untold = largest * np.random.default_rng(9).random(J.size)
    return np.asarray(np.maximum(J, np.minimum(untold, S)))


def with_jumps_of_steps(S: Floats, J: Floats, step: float) -> tuple[Floats, Floats]:
    """Draws of S and J (m,) with J raised to anything up to the largest jump that an OP in steps
    does not show, percent, and S by as much.

    The dead band S - J is what the stem stays behind; after it a ``step`` moves the stem whatever
    level (S + J)/2 it has exceeded. In the direction of the last move that is ``J < step``, after a
    reversal ``J < step - (S - J)``, where the step is wider than the dead band.
    """
    dead_band = S - J
    largest = np.where(step > dead_band, step - dead_band, step)
    raised = np.maximum(J, largest * np.random.default_rng(9).random(J.size))
    return dead_band + raised, raised


def _with_friction_alone(sample: StickSlipSample, fit: StickSlipFit) -> StickSlipSample:
    """Replace a tenth of the draws by those of friction alone, where its S is not much larger:
    there may be no lag beside it.
    """
    friction_alone = fit.alone
    if friction_alone is None or not fit.S <= friction_alone.S <= ALIKE * fit.S:
        return sample
    S, J = friction_alone.draws(round(SHARE_ALONE * REPLICATES), np.random.default_rng(8))
    return StickSlipSample(
        np.concatenate((S, sample.S[S.size :])), np.concatenate((J, sample.J[J.size :]))
    )


def _command_step(fit: StickSlipFit) -> float:
    """How far OP goes in a sample, shared among its reversals, percent."""
    turns = reversals(fit.evaluator.problem.op, 0.1 * fit.evaluator.problem.swing).size
    return float(way_in_a_sample(fit.evaluator.problem) / np.sqrt(1.0 + turns / 10.0))


def way_in_a_sample(problem: FitProblem) -> float:
    """Median step of OP between samples where it moves, percent."""
    moving = np.abs(np.diff(problem.op))
    moving = moving[moving > 0]
    return float(np.median(moving)) if moving.size else 0.0


def _blur(draws: Floats, step: float, model_error: float, rng: np.random.Generator) -> Floats:
    """Add the errors that are the same in every block, which a bootstrap over blocks cannot see.

    A slip is only seen at the next sample, so its level is known to the command's ``step`` at best;
    and no real stem is exactly the fitted element (``model_error``).
    """
    blurred = draws + step * (rng.random(draws.size) - 0.5)
    return np.maximum(blurred + model_error * rng.standard_normal(draws.size), 0.0)
