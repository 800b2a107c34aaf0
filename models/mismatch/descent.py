"""Robust least squares by Levenberg and Marquardt, with differences in place of derivatives.

With the breakaways assimilated, the residual of a run is nearly smooth in its parameters (what
jumps are single samples), so that a few dozen runs reach an optimum for which a population needs
hundreds. The loss is Cauchy's, by reweighting; a breakaway's distance from its level is a residual
like any other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from stemwatch.models.mismatch import bench as at
from stemwatch.models.mismatch.bench import Bench, Layout, batches
from stemwatch.models.mismatch.onsets import Samples
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
    if rounds <= 0:
        return Found(start.copy(), float(loss(start[None, :])[0]))
    seen = _seen(bench, blocks)
    best = Found(start.copy(), np.inf)
    free = layout.bounds.high > layout.bounds.low
    free[at.RESTICK] = False  # a stem sticks or does not: there is nothing to differentiate
    for _ in range(rounds):
        normal, slope, here = _linearised(bench, layout, seen, best.candidate, free)
        best = Found(best.candidate, here)
        trial = _trials(layout, best.candidate, normal, slope, free)
        values = loss(trial)
        i = int(np.argmin(values))
        gained = best.loss - float(values[i])
        if gained > 0.0:
            best = Found(trial[i], float(values[i]))
        if gained <= SMALLEST_GAIN * best.loss:
            break
    return best


@dataclass(frozen=True)
class _Seen:
    """What a descent is fitted to: some ``blocks`` of time, their scored ``samples`` (m,), the
    ``block`` (n,) of each sample, -1 outside, and the breakaways (e,) on them."""

    blocks: Bools
    block: Samples
    samples: Samples
    events: Samples


def _seen(bench: Bench, blocks: Bools) -> _Seen:
    """The samples of some blocks; a run is early or late only where the recorded stem lets go."""
    block = bench.within(blocks)
    at_onsets = bench.onsets.at[block[bench.onsets.at] >= 0]
    return _Seen(blocks, block, np.flatnonzero(block >= 0), at_onsets)


def _steps(layout: Layout, candidate: Floats) -> Floats:
    """(size,) steps of the differences, turned inwards at an upper limit."""
    low, high = layout.bounds.low, layout.bounds.high
    steps = np.maximum(_STEP_SHARE * np.abs(candidate), _STEP_RANGE * (high - low))
    steps[: at.N_BASE] = _BASE_STEPS
    steps[at.S_PERCENT] = max(_BASE_STEPS[0], 0.01 * candidate[at.S_PERCENT])
    return np.where(candidate + steps > high, -steps, steps)


@njit(cache=True)
def _residuals(
    simulated: Floats,
    mv: Floats,
    slack: Floats,
    samples: Samples,
    early_late: Floats,
    events: Samples,
    event_scale: float,
    rows: Floats,
) -> None:
    """Residuals at ``samples`` (m,), then at the breakaways ``events`` (e,), of each run (n,)."""
    for j in range(rows.shape[0]):
        for i in range(samples.size):
            k = samples[i]
            off = mv[k] - simulated[j, k]
            rows[j, i] = off - min(max(off, -slack[k]), slack[k])
        for i in range(events.size):
            rows[j, samples.size + i] = early_late[j, events[i]] * event_scale


@njit(cache=True)
def _weighted(rows: Floats, steps: Floats, m: int, event: float, delta: float) -> None:
    """Rows (1 + k, m + e) of residuals, the first one's and after each step, to differences.

    Each becomes the derivative by its coordinate, negative, times the root of Cauchy's weight;
    from column ``m`` on they are breakaways, which count for ``event`` samples.
    """
    root = np.empty(rows.shape[1])
    for i in range(root.size):
        share = rows[0, i] / delta
        root[i] = np.sqrt((event if i >= m else 1.0) / (1.0 + share * share))
    for j in range(1, rows.shape[0]):
        for i in range(root.size):
            rows[j, i] = (rows[0, i] - rows[j, i]) / steps[j - 1] * root[i]
    for i in range(root.size):
        rows[0, i] *= root[i]


def _linearised(
    bench: Bench, layout: Layout, seen: _Seen, candidate: Floats, free: Bools
) -> tuple[Floats, Floats, float]:
    """(k, k) normal matrix and (k,) right-hand side over the free coordinates, and the loss."""
    index = np.flatnonzero(free)
    steps = _steps(layout, candidate)[index]
    moved = np.tile(candidate, (index.size + 1, 1))
    moved[np.arange(1, index.size + 1), index] += steps
    m, scale, here = seen.samples.size, bench.delta / bench.scatter, 0.0
    rows = np.empty((index.size + 1, m + seen.events.size))
    for part in batches(rows.shape[0]):
        runs = bench.run(layout, moved[part], seen.block)
        if part.start == 0:
            here = float(bench.mean_loss(runs.losses, seen.blocks)[0])
        _residuals(
            runs.simulated,
            bench.problem.mv,
            bench.slack,
            seen.samples,
            runs.early_late,
            seen.events,
            scale,
            rows[part],
        )
    _weighted(rows, steps, m, bench.event, bench.delta)
    product = rows @ rows.T
    return product[1:, 1:], product[1:, 0], here


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
