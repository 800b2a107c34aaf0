"""How much better a richer model is on the blocks that it was not fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats


@dataclass(frozen=True)
class Advantage:
    """How much better a richer model is on the blocks it was not fitted to."""

    mean: float  # mean log ratio of the block losses
    t: float  # mean / (standard error + 0.01)


def advantage(
    simple: Floats, rich: Floats, counts: Floats, delta: float, op_open: float = 0.0
) -> Advantage:
    """Compare two models block by block on what neither was fitted to.

    ``l = clip(log((simple + fl) / (rich + fl)), -2, 2)`` per block with ``fl = 1e-3 delta^2 +
    op_open^2``; neither one missed slip nor the uncertainty of OP from its recorder (``op_open``,
    percent) can dominate. With fewer than three filled blocks the result is (0, 0).
    """
    filled = counts > 0
    floor = 1e-3 * delta * delta + op_open * op_open
    ratio = (simple[filled] / counts[filled] + floor) / (rich[filled] / counts[filled] + floor)
    log = np.clip(np.log(ratio), -2.0, 2.0)
    if log.size < 3:
        return Advantage(0.0, 0.0)
    mean = float(log.mean())
    return Advantage(mean, float(mean / (log.std(ddof=1) / np.sqrt(log.size) + 0.01)))
