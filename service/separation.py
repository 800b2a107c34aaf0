"""How well a score tells two groups apart, and the limit that few of one group exceed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stemwatch.models.estimate import Estimate

_NORMAL_95 = 1.959964
_BESIDE = 1e-9  # far below one pair in the largest groups


def auc(healthy: Sequence[float], growing: Sequence[float]) -> Estimate:
    """Chance that a growing valve's score is above a healthy one's, ties half, 95 % interval.

    The interval's ends are the values that lie 1.96 of their own standard errors from what was
    found, after Hanley and McNeil (1982) with the mean of the two group sizes: method 5 of Newcombe
    (2006), both quoted from memory. Unlike a bootstrap it does not shrink to nothing at 1. Where
    the groups are the same loops, as here, it is a little too wide. Unknown where a group is empty.
    """
    if not healthy or not growing:
        return Estimate.unknown("no valve of one group could be scored; follow more valves")
    above = np.subtract.outer(np.asarray(growing), np.asarray(healthy))
    found = float(np.mean((above > 0) + 0.5 * (above == 0)))
    low, high = _newcombe(found, len(healthy), len(growing))
    return Estimate(value=found, low=low, high=high)


def _newcombe(found: float, m: int, n: int) -> tuple[float, float]:
    from scipy.optimize import brentq

    larger = (m + n) / 2 - 1

    def variance(area: float) -> float:
        spread = 1 + larger * ((1 - area) / (2 - area) + area / (1 + area))
        return area * (1 - area) * spread / (m * n)

    def excess(area: float) -> float:
        return (found - area) ** 2 - _NORMAL_95**2 * variance(area)

    # The excess is below zero next to ``found``, above it at the far end, and 0 at ``found`` itself
    # where that is 0 or 1: the search begins beside it.
    low = 0.0 if found <= 0.0 else float(brentq(excess, 0.0, found - _BESIDE))
    high = 1.0 if found >= 1.0 else float(brentq(excess, found + _BESIDE, 1.0))
    return low, high


def calibrated_limit(healthy: Sequence[float], share: float) -> float | None:
    """The lowest limit, in tenths, that at most ``share`` of ``healthy`` exceed.

    ``None`` where there is no healthy score. A small share rests on few scores: with 200 of them,
    2 % are the four highest.
    """
    if not healthy:
        return None
    found = float(np.quantile(healthy, 1.0 - share, method="higher"))
    return float(np.ceil(10.0 * found - 1e-9) / 10.0)
