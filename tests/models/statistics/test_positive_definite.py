"""Systems of equations in compiled loops, against NumPy's."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.statistics.positive_definite import solve


@pytest.mark.parametrize("size", [1, 2, 7, 11])
def test_a_system_is_solved_as_numpy_solves_it(size):
    """In place, for systems of the sizes that are solved here."""
    rng = np.random.default_rng(size)
    root = rng.normal(size=(size, size + 3))
    a, b = root @ root.T, rng.normal(size=size)
    expected = np.linalg.solve(a, b)
    solve(a.copy(), b)
    np.testing.assert_allclose(b, expected, rtol=1e-9)
