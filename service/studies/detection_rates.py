"""How often something was found: the share of what was counted, and how well a score tells two
groups apart (the area under the ROC curve, and what a limit finds)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stemwatch.models.estimate import NORMAL_95, Estimate
from stemwatch.models.recording import Floats

_BESIDE = 1e-9  # far below one pair in the largest groups


def wilson(hits: int, total: int) -> tuple[float, float]:
    """95 % interval of the share ``hits`` of ``total``: Wilson (1927).

    doi:10.1080/01621459.1927.10502953. Nothing counted is 0 to 1.
    """
    if total == 0:
        return 0.0, 1.0
    z, share = NORMAL_95, hits / total
    middle = share + z * z / (2 * total)
    half = z * float(np.sqrt(share * (1 - share) / total + z * z / (4 * total * total)))
    return max((middle - half) / (1 + z * z / total), 0.0), min(
        (middle + half) / (1 + z * z / total), 1.0
    )


def area_under_roc(good: Floats, bad: Floats) -> float:
    """The probability that one of ``good`` (n,) scores higher than one of ``bad`` (m,), ties half:
    the area under the ROC curve (AUC)."""
    return float(np.mean((good[:, None] > bad) + 0.5 * (good[:, None] == bad)))


def sensitivity(good: Floats, bad: Floats, alarms: float) -> float:
    """The share of ``good`` above all but a share ``alarms`` of ``bad``."""
    return float(np.mean(good > max(float(np.quantile(bad, 1.0 - alarms)), 0.0)))


def area_estimate(good: Sequence[float], bad: Sequence[float]) -> Estimate:
    """``area_under_roc`` with its 95 % interval.

    The interval's ends are the values that lie 1.96 of their own standard errors from what was
    found, after Hanley and McNeil (1982) with the mean of the two group sizes: method 5 of Newcombe
    (2006), both quoted from memory. Unlike a bootstrap it does not shrink to nothing at 1. Where
    both groups are the same loops it is a little too wide. Unknown where a group is empty.
    """
    if not good or not bad:
        return Estimate.unknown("no valve of one group could be scored; follow more valves")
    area = area_under_roc(np.asarray(good, dtype=np.float64), np.asarray(bad, dtype=np.float64))
    low, high = _newcombe(area, len(bad), len(good))
    return Estimate(value=area, low=low, high=high)


def _newcombe(rate: float, m: int, n: int) -> tuple[float, float]:
    from scipy.optimize import brentq

    larger = (m + n) / 2 - 1

    def variance(area: float) -> float:
        spread = 1 + larger * ((1 - area) / (2 - area) + area / (1 + area))
        return area * (1 - area) * spread / (m * n)

    def excess(area: float) -> float:
        return (rate - area) ** 2 - NORMAL_95**2 * variance(area)

    # The excess is below zero next to ``rate``, above it at the far end, and 0 at ``rate`` itself
    # where that is 0 or 1: the search begins beside it.
    low = 0.0 if rate <= 0.0 else float(brentq(excess, 0.0, rate - _BESIDE))
    high = 1.0 if rate >= 1.0 else float(brentq(excess, rate + _BESIDE, 1.0))
    return low, high
