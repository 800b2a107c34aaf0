"""A flow that stands for the position, put back into percent of OP.

Where no position is measured, the flow shows the motion of the stem through the valve's
characteristic: a rising curve of unknown shape, flat where the valve is shut. For a stem ``x`` that
follows OP through a delay, a lag and a dead band, the characteristic is the isotonic regression of
the flow on ``x``. The delay, lag and band with the least squared error are taken, and the inverse
of their curve gives the position. Where the curve is flat the flow does not show the stem, and the
samples are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import PERCENT, Floats, Quality, Recording, Role
from stemwatch.models.signals.holes import held
from stemwatch.models.stickslip import kernel

BANDS = (0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 9.0, 11.0, 14.0)  # percent
DELAYS = (0.0, 1.0, 2.0, 3.5, 6.0)  # samples or seconds, whichever is longer
LAGS = (0.0, 1.0, 2.5, 5.0, 8.0, 12.0)
KNOTS = 41  # of the characteristic over the range of OP
FLAT = 0.12  # of the median slope, below which the flow does not show the stem
GOES_WITH = 0.97  # of the flow's variance that the curve must explain
FEWEST = 200


@dataclass(frozen=True)
class Characteristic:
    """Flow against stem: ``place`` (k,) percent of OP, ``flow`` (k,), rising; ``share`` of the
    flow's variance that it explains."""

    place: Floats
    flow: Floats
    share: float


def as_position(recording: Recording) -> tuple[Recording, Characteristic] | None:
    """The recording with its flow read as a position in percent, or ``None`` where the MV is a
    position already, or no rising curve explains the flow."""
    mv = recording.mv
    if mv is None or mv.unit == PERCENT or np.count_nonzero(recording.usable) < FEWEST:
        return None
    usable = recording.usable
    op = held(recording.op.values, recording.op.usable)
    flow = mv.values
    best, curve = np.inf, None
    for band, delay, lag in product(BANDS, DELAYS, LAGS):
        stem = _follow(op, band, delay, lag, recording.interval_s)
        squares_left, trial = _curve(stem[usable], flow[usable])
        if squares_left < best:
            best, curve = squares_left, trial
    if curve is None or curve.share < GOES_WITH:
        return None
    position, is_informative = _backwards(curve, flow)
    quality = np.where(is_informative, mv.quality, np.uint8(Quality.BAD)).astype(np.uint8)
    signal = replace(mv, values=position, quality=quality, unit=PERCENT)
    signals = {**recording.signals, Role.MV: signal}
    return replace(recording, signals=signals), curve


def _follow(op: Floats, band: float, delay: float, lag: float, interval_s: float) -> Floats:
    """(n,) a stem behind a delay, a lag and a dead band, percent."""
    unit = max(interval_s, 1.0)
    q = np.zeros(kernel.N_PARAMETERS)
    q[[kernel.S, kernel.DEAD_TIME_S]] = band, delay * unit
    q[[kernel.LAG_UP_S, kernel.LAG_DOWN_S]] = lag * unit
    q[[kernel.RATE_UP, kernel.RATE_DOWN]] = np.inf
    q[kernel.GAIN] = 1.0
    start = np.zeros(op.size, dtype=np.uint8)
    start[0] = kernel.START
    out = np.empty(op.size)
    kernel.simulate(op, op, start, interval_s, q, out)
    return out


def _curve(stem: Floats, flow: Floats) -> tuple[float, Characteristic]:
    """The sum of squares that the isotonic curve leaves, and the curve on even knots."""
    from scipy.optimize import isotonic_regression  # slow to import; where MV is measured, unused

    order = np.argsort(stem, kind="stable")
    x, y = stem[order], flow[order]
    fitted = isotonic_regression(y).x
    squares_left = float(np.sum((y - fitted) ** 2))
    total = float(np.sum((y - y.mean()) ** 2))
    knots = np.linspace(x[0], x[-1], KNOTS)
    smooth = np.interp(knots, x, fitted)
    share = 1.0 - squares_left / total if total > 0.0 else 0.0
    return squares_left, Characteristic(place=knots, flow=smooth, share=share)


def _backwards(curve: Characteristic, flow: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """(n,) the place on the curve at which each flow lies, and where the curve is steep enough to
    show it.
    """
    slope = np.gradient(curve.flow, curve.place)
    usual_slope = float(np.median(slope[slope > 0.0])) if np.any(slope > 0.0) else 0.0
    steep = slope > FLAT * usual_slope
    # A curve that rises a little everywhere has an inverse.
    rising = curve.flow + 1e-9 * np.arange(curve.flow.size) * max(float(np.ptp(curve.flow)), 1e-9)
    position = np.interp(flow, rising, curve.place)
    is_steep = np.interp(position, curve.place, steep.astype(np.float64)) > 0.5
    in_range = (flow > rising[0]) & (flow < rising[-1])
    return position, np.asarray(is_steep & in_range & np.isfinite(flow))
