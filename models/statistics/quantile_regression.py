"""Quantile regression: the plane below which a given share of the observations lies."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix, hstack, identity

from stemwatch.models.recording import Floats


def quantile_regression(columns: Floats, observed: Floats, share: float) -> Floats:
    """(k,) the weights w for which a share ``share`` (0 to 1) of ``observed`` (n,) lies below
    ``columns`` (n, k) times w.

    They have the least sum of share (y - x w) above the plane and of (1 - share) (x w - y) below,
    a linear programme: Koenker and Bassett 1978, doi:10.2307/1913643.
    """
    n, k = columns.shape
    cost = np.concatenate([np.zeros(k), np.full(n, share), np.full(n, 1.0 - share)])
    above_and_below = hstack([csr_matrix(columns), identity(n), -identity(n)], format="csr")
    bounds = [(None, None)] * k + [(0.0, None)] * (2 * n)
    solved = linprog(cost, A_eq=above_and_below, b_eq=observed, bounds=bounds, method="highs")
    return np.asarray(solved.x[:k])
