"""Small positive definite systems of equations, solved inside compiled loops."""

from __future__ import annotations

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats


@compiled(error_model="numpy")
def solve(a: Floats, b: Floats) -> None:
    """The solution of ``a x = b``, ``a`` (k, k) positive definite and ``b`` (k,), in the place of
    ``b``; ``a`` is written over. By elimination without pivots, which such a matrix does not need.
    """
    k = b.size
    for i in range(k):
        for j in range(i + 1, k):
            share = a[j, i] / a[i, i]
            for at in range(i + 1, k):
                a[j, at] -= share * a[i, at]
            b[j] -= share * b[i]
    for i in range(k - 1, -1, -1):
        for at in range(i + 1, k):
            b[i] -= a[i, at] * b[at]
        b[i] /= a[i, i]
