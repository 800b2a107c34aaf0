"""Published detectors of stiction, as our own implementations of the published formulas.

They judge oscillating loops by OP and PV alone and do not apply to a loop that does not oscillate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.signals.oscillation import oscillation
from stemwatch.models.statistics.cross_correlation import lagged_products
from stemwatch.models.without_position.wave_shapes import banded, triangle_beside_sine

NOT_OSCILLATING = "the loop does not oscillate regularly"


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Whether the valve sticks, ``None`` where the method gives no answer, and why."""

    sticks: bool | None
    reason: str


def horch(op: Floats, pv: Floats, *, integrating: bool) -> Detection:
    """Horch's cross-correlation of OP and PV (n,): odd for stiction, even for other causes.

    With the zero crossings ``-t_l < 0 < t_r`` next to lag 0, the correlation ``r_0`` at lag 0 and
    ``r_m`` of largest size between them: ``dr = |r_0 - r_m| / |r_0 + r_m|``, ``dt = |t_l - t_r| /
    (t_l + t_r)``; stiction where both are above 2/3, none where both are below 1/3. Not for
    integrating processes. Horch (1999), doi:10.1016/S0967-0661(99)00100-8; the two measures from
    his thesis of 2000, quoted from memory.
    """
    if integrating:
        return Detection(sticks=None, reason="the method is not for integrating processes")
    seen = oscillation(op, 1.0)
    if seen is None or not seen.regular:
        return Detection(sticks=None, reason=NOT_OSCILLATING)
    u, y = op - op.mean(), pv - pv.mean()
    lags = min(max(int(seen.period_s), 4), op.size // 2)
    forward, backward = lagged_products(u, y, lags), lagged_products(y, u, lags)
    right, left = _first_crossing(forward), _first_crossing(backward)
    if right is None or left is None:
        return Detection(sticks=None, reason="the correlation has no zero crossing within a period")
    between = np.concatenate([forward[: int(right) + 1], backward[: int(left) + 1]])
    largest, at_zero = float(between[np.argmax(np.abs(between))]), float(forward[0])
    dr = abs(at_zero - largest) / max(abs(at_zero + largest), 1e-12)
    dt = abs(left - right) / max(left + right, 1e-12)
    reason = f"dr {dr:.2f}, dt {dt:.2f}"
    if dr > 2.0 / 3.0 and dt > 2.0 / 3.0:
        return Detection(sticks=True, reason=reason)
    return Detection(sticks=False if max(dr, dt) < 1.0 / 3.0 else None, reason=reason)


def _first_crossing(correlation: Floats) -> float | None:
    """The lag, with a straight line between samples, at which the sign first changes."""
    sign = np.signbit(correlation)
    crossings = np.flatnonzero(sign[1:] != sign[:-1])
    if not crossings.size:
        return None
    k = int(crossings[0])
    return k + float(correlation[k] / (correlation[k] - correlation[k + 1]))


def he(op: Floats, pv: Floats, *, integrating: bool) -> Detection:
    """He's curve fitting: half cycles of OP (of PV where the process integrates) are triangles for
    stiction and sines otherwise.

    Index ``MSE_sine / (MSE_sine + MSE_triangle)`` over all half cycles; stiction above 0.6, none
    below 0.4. He, Wang, Pottmann and Qin (2007), doi:10.1021/ie0609280.
    """
    signal = pv if integrating else op
    seen = oscillation(signal, 1.0)
    if seen is None or not seen.regular:
        return Detection(sticks=None, reason=NOT_OSCILLATING)
    log_ratio = triangle_beside_sine(banded(signal, seen.period_s), seen.period_s)
    index = float(1.0 / (1.0 + np.exp(-log_ratio)))
    sticks = True if index > 0.6 else False if index < 0.4 else None
    return Detection(sticks=sticks, reason=f"index {index:.2f}")


PUBLISHED: Mapping[str, Callable[..., Detection]] = {"horch": horch, "he": he}
