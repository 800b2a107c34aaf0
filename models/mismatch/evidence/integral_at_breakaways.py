"""Whether a positioner that integrates has helped the stem to let go, as told before any search.

At a breakaway to the side ``d`` the force ``e + v``, ``e = OP - MV``, is at the level ``fs``, and
``v = V/T_i`` is what the positioner has integrated: ``V`` is the sum of ``e dt`` over the samples
at which ``e`` lies outside of the dead zone. So over the breakaways

    e = fs d + zero - V/T_i,

and the errors at which the stem lets go fall with the sum of all errors before. Without an
integral they do not: a breakaway that comes late by chance, or after a long rest, has summed up
more, and its ``e`` is larger for it. ``1/T_i`` is the slope of a regression with Cauchy's weights,
its error the larger of the usual one and that of residuals of different sizes (White 1980,
doi:10.2307/1912934). The zone is the share of the usual ``e`` that tells best.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stemwatch.models.mismatch.terms.integrating_positioner import QUICKEST_S, SLOWEST_S
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip.onsets import Onsets

INTEGRATING = "integrating_positioner"

FEWEST_BREAKAWAYS = 8
LEAST_T = 3.0
_ZONES = np.array([0.02, 0.2, 0.4, 0.55, 0.65, 0.75, 0.85, 0.95])  # shares of the usual error
_ROUNDS, _WIDE = 6, 2.0  # of the weights, and the residual that halves one, in standard deviations
_TINY = 1e-9


class IntegralAtBreakaways(NamedTuple):
    """``rate`` is 1/T_i in 1/s, ``t`` its ratio to its error, ``zone`` the dead zone in percent."""

    rate: float
    zone: float
    t: float

    @property
    def shows(self) -> bool:
        """Whether the positioner seems to integrate; the fit decides."""
        return self.t >= LEAST_T and 1.0 / SLOWEST_S <= self.rate <= 1.0 / QUICKEST_S


NOTHING_SEEN = IntegralAtBreakaways(0.0, 0.0, 0.0)


def _slopes(errors: Floats, sides: Floats, sums: Floats) -> tuple[Floats, Floats]:
    """(z,) slopes of ``errors`` (m,) on ``sums`` (z, m) beside ``sides`` (m,) and a constant, and
    their standard errors."""
    of_all = np.broadcast_to(np.stack((sides, np.ones_like(sides)), axis=-1), (*sums.shape, 2))
    rows = np.concatenate((of_all, sums[:, :, None]), axis=2)
    weights, residuals = np.ones_like(sums), np.zeros_like(sums)
    inverse: Floats = np.empty((sums.shape[0], 3, 3))
    slopes: Floats = np.empty((sums.shape[0], 3))
    for _ in range(_ROUNDS):
        weighted = rows * weights[:, :, None]
        inverse = np.asarray(np.linalg.pinv(np.swapaxes(weighted, 1, 2) @ rows), dtype=float)
        slopes = (inverse @ (np.swapaxes(weighted, 1, 2) @ errors)[:, :, None])[:, :, 0]
        residuals = errors - (rows @ slopes[:, :, None])[:, :, 0]
        spread = 1.4826 * np.median(np.abs(residuals), axis=1, keepdims=True) + _TINY
        weights = 1.0 / (1.0 + (residuals / (_WIDE * spread)) ** 2)
    off = weights * residuals
    usual = np.sum(off * residuals, axis=1) / max(sums.shape[1] - 3, 1) * inverse[:, 2, 2]
    parts = (rows * off[:, :, None]) @ inverse[:, :, 2:]
    return slopes[:, 2], np.sqrt(np.maximum(usual, np.sum(parts[:, :, 0] ** 2, axis=1))) + _TINY


def integral_at_breakaways(
    op: Floats, place: Floats, scored: Bools, onsets: Onsets, interval_s: float
) -> IntegralAtBreakaways:
    """Read ``1/T_i`` and the zone from the ``onsets``. ``op`` and ``place`` (n,), percent, the stem
    as it is read, of which only samples that are ``scored`` (n,) are summed up."""
    at = onsets.at[scored[onsets.at] & scored[onsets.at - 1]]
    if at.size < FEWEST_BREAKAWAYS:
        return NOTHING_SEEN
    error = np.where(scored, op - np.where(scored, place, 0.0), 0.0)
    sides = onsets.side[np.isin(onsets.at, at)]
    errors = error[at - 1] + 0.5 * (op[at] - op[at - 1])
    usual = float(np.median(errors * sides))
    if usual <= 0.0:
        return NOTHING_SEEN
    zones = usual * _ZONES
    outside = np.where(np.abs(error) > zones[:, None], error, 0.0)
    sums = (interval_s * np.cumsum(outside, axis=1))[:, at - 1]
    sums -= sums.mean(axis=1, keepdims=True)
    slopes, standard_errors = _slopes(errors, sides, sums)
    t = -slopes / standard_errors
    best = int(np.argmax(t))
    return IntegralAtBreakaways(-float(slopes[best]), float(zones[best]), float(t[best]))
