"""The common start of all fits of one recording: a first guess of the reading's zero and gain, the
bounds about it, and the scale of the loss.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats, Recording
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.evaluator import CANONICAL, StickSlipEvaluator
from stemwatch.models.stickslip.hypotheses import sticking_grid
from stemwatch.models.stickslip.parameters import bounds
from stemwatch.models.stickslip.problem import FitProblem, make_problem
from stemwatch.models.stickslip.search import best_of


@dataclass(frozen=True)
class FirstLook:
    """The common start of all fits of one recording in percent of travel: an evaluator of its
    problem, and the base candidate (9,).
    """

    evaluator: StickSlipEvaluator
    base: Floats

    @classmethod
    def of(cls, recording: Recording) -> FirstLook | None:
        """``None`` where OP does not move, or nothing can be scored."""
        if recording.mv is None:
            return None
        problem = make_problem(recording)
        if not problem.scored.any() or problem.swing <= 0.0:
            return None
        return cls(*first_look(problem))


def first_look(problem: FitProblem) -> tuple[StickSlipEvaluator, Floats]:
    """An evaluator scaled by a first look, and the base candidate (neutral but for the reading)."""
    base = np.zeros(coordinate.N_COORDINATES)
    base[coordinate.GAIN], base[coordinate.ZERO] = _reading(problem)
    spread = float(np.std(problem.mv[problem.scored]))
    evaluator = _scaled(problem, base, max(3.0 * problem.sigma, 0.1 * spread, 0.05))
    all_blocks = np.ones(problem.n_blocks, dtype=bool)
    best = best_of(evaluator.loss(all_blocks), sticking_grid(evaluator, base))[0]
    delta = loss_scale(problem, evaluator.simulate(best.candidate))
    return _scaled(problem, base, min(delta, evaluator.delta * 3.0)), base


def _reading(problem: FitProblem) -> tuple[float, float]:
    """First guess of (gain - 1, zero) from the axes of the OP-MV loop."""
    op, mv = problem.op[problem.scored], problem.mv[problem.scored]
    if problem.mv_is_percent:
        # Friction holds the stem within a band that is as wide above the command as below. Medians
        # would be biased by a stem that rests long on one side of it.
        low, high = np.percentile(mv - op, (2.0, 98.0))
        return 0.0, float(low + high) / 2.0
    span = float(np.ptp(np.percentile(op, (2.0, 98.0))))
    gain = float(np.ptp(np.percentile(mv, (2.0, 98.0)))) / span if span > 0 else 1.0
    if op.std() > 0.0 and mv.std() > 0.0 and np.corrcoef(op, mv)[0, 1] < 0:
        gain = -gain
    return gain - 1.0, float(np.median(mv) - gain * np.median(op))


def _scaled(problem: FitProblem, base: Floats, delta: float) -> StickSlipEvaluator:
    """The evaluator with bounds about ``base`` (9,) and a loss of scale ``delta``, percent."""
    free_gain = not problem.mv_is_percent
    limits = bounds(problem.swing, problem.interval_s, float(base[coordinate.ZERO]), free_gain)
    if free_gain:
        gain = float(base[coordinate.GAIN]) + 1.0
        limits.low[coordinate.GAIN], limits.high[coordinate.GAIN] = sorted(
            (0.6 * gain - 1.0, 1.7 * gain - 1.0)
        )
        reach = abs(gain) * 0.5 * problem.swing
        limits.low[coordinate.ZERO] = base[coordinate.ZERO] - reach
        limits.high[coordinate.ZERO] = base[coordinate.ZERO] + reach
    return StickSlipEvaluator(
        problem=problem, bounds=limits, delta=delta, restick=CANONICAL, free_gain=free_gain
    )


def loss_scale(problem: FitProblem, simulated: Floats) -> float:
    """Scale of the robust loss: three times the noise, or the bulk of the residual."""
    residual = (problem.mv - simulated)[problem.scored]
    spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    return max(3.0 * problem.sigma, spread, 0.05)
