"""The lag of the first order, ``p += (1 - exp(-dt/tau)) (u - p)``: one for all who need one.

It is exact for a command that is held between samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats


@compiled()
def lag_by_direction(
    command: Floats, marks: NDArray[np.uint8], dt: float, up_s: float, down_s: float, out: Floats
) -> None:
    """Lag of ``command`` (n,) into ``out`` (n,), in its unit; at rest where ``marks`` (n,) are 1.

    ``dt`` is the interval, ``up_s`` and ``down_s`` the time constants towards a higher and a lower
    command, seconds; equal ones are the plain lag.
    """
    up = 1.0 - np.exp(-dt / up_s) if up_s > 1e-3 else 1.0
    down = 1.0 - np.exp(-dt / down_s) if down_s > 1e-3 else 1.0
    p = command[0]
    for k in range(command.size):
        if marks[k] == 1:
            p = command[k]
        else:
            error = command[k] - p
            p += (up if error > 0.0 else down) * error
        out[k] = p


def first_order_lag(values: Floats, lag: float) -> Floats:
    """(n,) ``values`` through a lag of ``lag`` samples, at rest before the first of them."""
    out = np.empty(values.size)
    at_rest_anew = np.zeros(values.size, dtype=np.uint8)
    # A copy, since a recording's values are read-only: for those the kernel is compiled once more.
    lag_by_direction(values.copy(), at_rest_anew, 1.0, float(lag), float(lag), out)
    return out
