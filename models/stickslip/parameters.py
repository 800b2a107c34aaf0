"""The search coordinates of a valve, in which every effect is switched off at zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.stickslip import kernel

# Coordinates (n_coordinates,) of a candidate: all neutral at 0, so that hypotheses nest.
S_PERCENT, RATIO, DEAD_TIME_S, LAG_UP_S, LAG_DOWN_S, SLOW_UP, SLOW_DOWN, ZERO, GAIN = range(9)
N_COORDINATES = 9

STICKING = (S_PERCENT, RATIO)
ACTUATOR = (DEAD_TIME_S, LAG_UP_S, LAG_DOWN_S, SLOW_UP, SLOW_DOWN)
READING = (ZERO,)


@dataclass(frozen=True)
class Bounds:
    """Lower and upper limit of each coordinate, (9,) each."""

    low: Floats
    high: Floats

    def clip(self, candidates: Floats) -> Floats:
        """Candidates (m, 9), each coordinate moved to the nearest limit where it is beyond one."""
        return np.clip(candidates, self.low, self.high)


def bounds(swing: float, interval_s: float, zero: float, free_gain: bool) -> Bounds:
    """Plausible ranges of a valve's coordinates for this swing of OP and sampling interval.

    S up to 1.2 times the swing: a wider one would never have moved. Dead time up to 8 s or four
    samples, lags up to 15 s or six samples, speeds down to 0.2 %/s (catalogue of omitted
    effects: plausible ranges). ``zero`` is the centre of the search for the reading's offset.
    """
    reach = max(1.2 * swing, 2.0)
    dead_time = max(8.0, 4.0 * interval_s)
    lag = max(15.0, 6.0 * interval_s)
    offset = max(0.5 * swing, 3.0)
    gain_low, gain_high = (-0.95, 20.0) if free_gain else (0.0, 0.0)
    low = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, zero - offset, gain_low]
    high = [reach, 2.0, dead_time, lag, lag, 5.0, 5.0, zero + offset, gain_high]
    return Bounds(low=np.array(low), high=np.array(high))


def to_kernel(candidates: Floats, restick: float) -> Floats:
    """Coordinates (m, 9) to kernel parameters (m, 10): J = S ratio, speed limit = 1 / slowness."""
    c = np.atleast_2d(candidates)
    q = np.empty((c.shape[0], kernel.N_PARAMETERS))
    q[:, kernel.S] = c[:, S_PERCENT]
    q[:, kernel.J] = c[:, S_PERCENT] * c[:, RATIO]
    q[:, kernel.DEAD_TIME_S] = c[:, DEAD_TIME_S]
    q[:, kernel.LAG_UP_S] = c[:, LAG_UP_S]
    q[:, kernel.LAG_DOWN_S] = c[:, LAG_DOWN_S]
    with np.errstate(divide="ignore"):
        q[:, kernel.RATE_UP] = np.where(c[:, SLOW_UP] > 1e-3, 1.0 / c[:, SLOW_UP], np.inf)
        q[:, kernel.RATE_DOWN] = np.where(c[:, SLOW_DOWN] > 1e-3, 1.0 / c[:, SLOW_DOWN], np.inf)
    q[:, kernel.ZERO] = c[:, ZERO]
    q[:, kernel.GAIN] = 1.0 + c[:, GAIN]
    q[:, kernel.RESTICK] = restick
    return q


def S_and_J(candidate: Floats) -> tuple[float, float]:
    """S and J of a candidate (9,), percent of OP span."""
    S = float(candidate[S_PERCENT])
    return S, S * float(candidate[RATIO])
