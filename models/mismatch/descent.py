"""Robust least squares by Levenberg and Marquardt, with differences in place of derivatives.

With the breakaways assimilated, the residual of a run is nearly smooth in its parameters (what
jumps are single samples), so that a few dozen runs reach an optimum for which a population needs
hundreds. The loss is Cauchy's, by reweighting; a breakaway's distance from its level is a residual
like any other.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch import bench as at
from stemwatch.models.mismatch.bench import Bench, Layout
from stemwatch.models.mismatch.stem import EVENT
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip.search import Found

DAMPING = (0.003, 0.1, 3.0)  # tried side by side in every round
SMALLEST_GAIN = 2e-3  # a round that lowers the loss by a smaller share is the last
# Differences wide enough that a sample which jumps does not rule them.
_STEP_SHARE, _STEP_RANGE = 0.03, 0.004
_BASE_STEPS = np.array([0.02, 0.015, 0.04, 0.004, 0.04, 0.05])


def descend(bench: Bench, layout: Layout, blocks: Bools, start: Floats, rounds: int) -> Found:
    """The candidate (size,) reached from ``start`` by at most ``rounds``; never worse than it."""
    loss = bench.loss(layout, blocks)
    inside = np.append(blocks, False)[bench.problem.block]  # block -1 is the False at the end
    best = Found(start.copy(), float(loss(start[None, :])[0]))
    free = layout.bounds.high > layout.bounds.low
    free[at.RESTICK] = False  # a stem sticks or does not: there is nothing to differentiate
    for _ in range(rounds):
        steps = _steps(layout, best.candidate)
        normal, slope = _linearised(bench, layout, inside, best.candidate, steps, free)
        trial = _trials(layout, best.candidate, normal, slope, free)
        values = loss(trial)
        i = int(np.argmin(values))
        gained = best.loss - float(values[i])
        if gained > 0.0:
            best = Found(trial[i], float(values[i]))
        if gained <= SMALLEST_GAIN * best.loss:
            break
    return best


def _steps(layout: Layout, candidate: Floats) -> Floats:
    """(size,) steps of the differences, turned inwards at an upper limit."""
    low, high = layout.bounds.low, layout.bounds.high
    steps = np.maximum(_STEP_SHARE * np.abs(candidate), _STEP_RANGE * (high - low))
    steps[: at.N_BASE] = _BASE_STEPS
    steps[at.S_PERCENT] = max(_BASE_STEPS[0], 0.01 * candidate[at.S_PERCENT])
    return np.where(candidate + steps > high, -steps, steps)


def _rows(bench: Bench, layout: Layout, inside: Bools, candidate: Floats) -> Floats:
    """(2 m,) residuals on the chosen samples, then the breakaways', scaled to the same loss."""
    simulated, early_late = bench.assimilated(layout, candidate)
    residual = (bench.problem.mv - simulated)[inside]
    return np.concatenate((residual, early_late[inside] * (bench.delta / bench.scatter)))


def _linearised(
    bench: Bench, layout: Layout, inside: Bools, candidate: Floats, steps: Floats, free: Bools
) -> tuple[Floats, Floats]:
    """(k, k) normal matrix and (k,) right-hand side over the free coordinates."""
    rows = _rows(bench, layout, inside, candidate)
    weight = 1.0 / (1.0 + (rows / bench.delta) ** 2)
    weight[rows.size // 2 :] *= EVENT
    index = np.flatnonzero(free)
    jacobian = np.empty((index.size, rows.size))
    for row, i in zip(jacobian, index, strict=True):
        moved = candidate.copy()
        moved[i] += steps[i]
        row[:] = (rows - _rows(bench, layout, inside, moved)) / steps[i]
    weighted = jacobian * weight
    return weighted @ jacobian.T, weighted @ rows


def _trials(
    layout: Layout, candidate: Floats, normal: Floats, slope: Floats, free: Bools
) -> Floats:
    """(3, size) where the damped steps lead."""
    diagonal = np.diag(normal)
    floor = 1e-9 * max(float(diagonal.max(initial=0.0)), 1e-12)
    damped = np.repeat(normal[None], len(DAMPING), axis=0)
    index = np.arange(diagonal.size)
    damped[:, index, index] += np.outer(DAMPING, diagonal) + floor
    steps = np.linalg.solve(damped, np.broadcast_to(slope[:, None], (*damped.shape[:2], 1)))
    trials = np.tile(candidate, (len(DAMPING), 1))
    trials[:, free] += steps[:, :, 0]
    return layout.bounds.clip(trials)
