"""The canonical stick-slip element written anew, so that no kernel is tested against itself."""

from __future__ import annotations

import numpy as np


def stick_slip(u: np.ndarray, S: float, J: float) -> np.ndarray:
    """(n,) the stem over the command ``u`` with S and J, percent."""
    breakaway, sliding = (S + J) / 2, (S - J) / 2
    y, moving, side = [u[0]], False, 1
    for k in range(1, u.size):
        if moving and side * (u[k] - u[k - 1]) <= 0:
            moving = False
        if not moving and abs(u[k] - y[-1]) > breakaway:
            moving, side = True, 1 if u[k] > y[-1] else -1
        y.append(u[k] - side * sliding if moving else y[-1])
    return np.array(y)
