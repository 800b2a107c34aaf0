"""Intervals of all parameters by a block bootstrap that never refits.

As for S and J alone (``stickslip.interval``): a cloud of candidates around the optimum is simulated
once; a replicate is a reweighting of the blocks of time, and its estimate the cloud's best
candidate under these weights.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.evaluator import CoordinateLayout, Evaluator
from stemwatch.models.recording import Floats

REPLICATES = 240
CLOUD = 160
ROUNDS = 3
COVERAGE = (2.5, 97.5)
FIRST_WIDTH = 0.015
_SMALLEST = 1e-4


def draws(evaluator: Evaluator, layout: CoordinateLayout, best: Floats) -> Floats:
    """(REPLICATES, size) what the coordinates could have been, by the blocks of time. Seeded."""
    rng = np.random.default_rng(11)
    weights = _weights(evaluator.counts, rng)
    width = evaluator.spread(layout, FIRST_WIDTH)
    smallest = evaluator.spread(layout, _SMALLEST)
    drawn = best[None, :]
    seen = np.empty((0, layout.size))
    losses = np.empty((0, evaluator.problem.n_blocks))
    for _ in range(ROUNDS):
        centre = drawn[rng.integers(drawn.shape[0], size=CLOUD)]
        cloud = layout.bounds.clip(centre + width * rng.standard_normal(centre.shape))
        if not seen.size:
            cloud[0] = best
        seen = np.vstack((seen, cloud))
        losses = np.vstack((losses, evaluator.block_losses(layout, cloud)))
        totals = weights @ losses.T
        totals += 1e-9 * totals.mean() * rng.random(totals.shape)
        drawn = seen[np.argmin(totals, axis=1)]
        width = np.where(width > 0, np.maximum(0.6 * drawn.std(axis=0), smallest), 0.0)
    return np.asarray(drawn)


def _weights(counts: Floats, rng: np.random.Generator) -> Floats:
    """(REPLICATES, n_blocks) how often each block is drawn; empty ones never."""
    filled = np.flatnonzero(counts > 0)
    weights = np.zeros((REPLICATES, counts.size))
    share = np.full(filled.size, 1.0 / filled.size)
    weights[:, filled] = rng.multinomial(filled.size, share, size=REPLICATES)
    return weights


def estimate(values: Floats, best: float, unit: str, error: float = 0.0) -> Estimate:
    """``best`` with the 95 % interval of ``values`` (m,), widened by a model error (one sigma)."""
    low, high = np.percentile(values, COVERAGE)
    low, high = min(float(low), best), max(float(high), best)
    below = float(np.hypot(best - low, 1.96 * error))
    above = float(np.hypot(high - best, 1.96 * error))
    return Estimate(value=best, low=best - below, high=best + above, unit=unit)
