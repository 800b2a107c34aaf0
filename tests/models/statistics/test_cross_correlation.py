"""Products over lag by a spectrum are the sums that they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.statistics.cross_correlation import lagged_products


@pytest.mark.parametrize("n", [2, 3, 64, 101, 1000])
@pytest.mark.parametrize("same", [False, True], ids=["two signals", "one signal"])
def test_each_lag_is_its_sum(n, same):
    """No lag that was asked for wraps round, up to the last that there is."""
    rng = np.random.default_rng(n)
    first = rng.standard_normal(n)
    second = first if same else rng.standard_normal(n)
    sums = [first[: n - lag] @ second[lag:] for lag in range(n)]
    for lags in {1, n // 2, n}:
        result = lagged_products(first, second, lags)
        np.testing.assert_allclose(result, sums[:lags], rtol=1e-12, atol=1e-12 * n)
