"""Intervals of all parameters by the block bootstrap (``models.statistics.block_bootstrap``).

As for S and J alone (``stickslip.interval``), but the blocks are drawn once and the candidates of
all rounds are kept, because a run costs more here.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout, Evaluator
from stemwatch.models.recording import Floats
from stemwatch.models.statistics.block_bootstrap import COVERAGE, block_weights, cheapest

REPLICATES = 240
CLOUD = 160
ROUNDS = 3
FIRST_WIDTH = 0.015
_SMALLEST = 1e-4


def draws(evaluator: Evaluator, layout: CoordinateLayout, best: Floats) -> Floats:
    """(REPLICATES, size) the coordinates from a block bootstrap. Seeded."""
    rng = np.random.default_rng(11)
    weights = block_weights(evaluator.counts, REPLICATES, rng)
    width = evaluator.spread(layout, FIRST_WIDTH)
    smallest = evaluator.spread(layout, _SMALLEST)
    candidate_draws = best[None, :]
    seen = np.empty((0, layout.size))
    losses = np.empty((0, evaluator.problem.n_blocks))
    for _ in range(ROUNDS):
        centre = candidate_draws[rng.integers(candidate_draws.shape[0], size=CLOUD)]
        cloud = layout.bounds.clip(centre + width * rng.standard_normal(centre.shape))
        if not seen.size:
            cloud[0] = best
        seen = np.vstack((seen, cloud))
        losses = np.vstack((losses, evaluator.block_losses(layout, cloud)))
        candidate_draws = cheapest(seen, losses, weights, rng)
        width = np.where(width > 0, np.maximum(0.6 * candidate_draws.std(axis=0), smallest), 0.0)
    return np.asarray(candidate_draws)


def estimate(values: Floats, best: float, unit: str, error: float = 0.0) -> Estimate:
    """``best`` with the 95 % interval of ``values`` (m,), widened by a model error (one sigma)."""
    low, high = np.percentile(values, COVERAGE)
    low, high = min(float(low), best), max(float(high), best)
    error_below = float(np.hypot(best - low, 1.96 * error))
    error_above = float(np.hypot(high - best, 1.96 * error))
    return Estimate(value=best, low=best - error_below, high=best + error_above, unit=unit)
