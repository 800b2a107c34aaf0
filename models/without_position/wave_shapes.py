"""The shapes by which the literature tells a sticking valve from OP and PV alone, as numbers.

None of them decides: a trained network weighs them (``models.without_position.network``).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from stemwatch.models.cross_correlation import lagged_products
from stemwatch.models.recording import Floats

NAMES = (
    "kurtosis of OP",
    "kurtosis of PV",
    "kurtosis of OP's steps",
    "kurtosis of PV's steps",
    "skewness of OP's steps",
    "skewness of PV's steps",
    "triangle beside sine, OP",
    "triangle beside sine, PV",
    "peak place, OP",
    "peak place, PV",
    "correlation at no lag",
    "greatest correlation",
    "lag of it",
    "oddness of the correlation",
    "regularity of OP",
    "regularity of PV",
    "PV at rest",
    "jumps of PV",
    "loop area",
    "qualitative shapes",
)


def wave_shapes(op: Floats, pv: Floats, period: float) -> Floats:
    """(20,) the shapes of ``op`` and ``pv`` (n,), block means over some 25 to a period.

    ``period`` is in samples of these. ``NAMES`` has what each is. Cross-correlation: Horch (1999),
    doi:10.1016/S0967-0661(99)00100-8. Triangle beside sine: He, Wang, Pottmann and Qin (2007),
    doi:10.1021/ie0609280. Qualitative shapes: Yamashita (2006),
    doi:10.1016/j.conengprac.2005.03.011.
    """
    u, y = _banded(op, period), _banded(pv, period)
    du, dy = np.diff(op), np.diff(pv)
    triangle_u, place_u = _half_cycles(u, period)
    triangle_y, place_y = _half_cycles(y, period)
    at_zero, most, lag, odd = _correlation(u, y, period)
    rest, jumps = _rest_and_jumps(dy)
    return np.array(
        [
            _moment(u, 4),
            _moment(y, 4),
            np.log(_moment(du, 4)),
            np.log(_moment(dy, 4)),
            abs(_moment(du, 3)),
            abs(_moment(dy, 3)),
            triangle_u,
            triangle_y,
            place_u,
            place_y,
            at_zero,
            most,
            lag,
            odd,
            _regularity(u, period),
            _regularity(y, period),
            rest,
            jumps,
            _area(u, y, period),
            _yamashita(op, pv),
        ]
    )


def _banded(values: Floats, period: float) -> Floats:
    """Between a third and six times the period's frequency, of unit size."""
    n = values.size
    line = np.linspace(values[0], values[-1], n)
    spectrum = np.fft.rfft(values - line)
    frequency = np.arange(spectrum.size) / n
    spectrum[(frequency < 0.33 / period) | (frequency > 6.0 / period)] = 0.0
    kept = np.fft.irfft(spectrum, n)
    return np.asarray(kept / max(float(np.std(kept)), 1e-9))


def _moment(values: Floats, order: int) -> float:
    away = values - values.mean()
    spread = max(float(np.std(away)), 1e-12)
    return float(np.mean((away / spread) ** order)) + (1e-6 if order == 4 else 0.0)


def _half_cycles(wave: Floats, period: float) -> tuple[float, float]:
    """How much better triangles fit the half cycles than sines do (log ratio), and where in the
    half cycle the peak stands (0 is the middle)."""
    sign = np.signbit(wave)
    crossings = np.flatnonzero(sign[1:] != sign[:-1]) + 1
    sine = triangle = 1e-9
    places = []
    for start, stop in pairwise(crossings):
        count = stop - start
        if count < 4 or count > 2.0 * period:
            continue
        part = np.abs(wave[start:stop])
        time = (np.arange(count) + 0.5) / count
        arch = np.sin(np.pi * time)
        peak = min(max(float(time[int(np.argmax(part))]), 0.15), 0.85)
        roof = np.minimum(time / peak, (1.0 - time) / (1.0 - peak))
        sine += _misfit(part, arch)
        triangle += _misfit(part, roof)
        places.append(abs(peak - 0.5))
    return float(np.log(sine / triangle)), float(np.mean(places)) if places else 0.0


def _misfit(part: Floats, shape: Floats) -> float:
    height = float(part @ shape) / float(shape @ shape)
    return float(np.sum((part - height * shape) ** 2))


def _correlation(u: Floats, y: Floats, period: float) -> tuple[float, float, float, float]:
    lags = max(int(period), 2)
    n = u.size
    forward = lagged_products(u, y, lags)[:lags] / n
    backward = lagged_products(y, u, lags)[:lags] / n
    both = np.concatenate([backward[:0:-1], forward])
    at = int(np.argmax(np.abs(both)))
    half = max(lags // 2, 1)
    even = float(np.sum((forward[1:half] + backward[1:half]) ** 2))
    odd = float(np.sum((forward[1:half] - backward[1:half]) ** 2))
    share = odd / max(even + odd, 1e-12)
    return float(forward[0]), float(both[at]), (at - lags + 1) / period, share


def _regularity(wave: Floats, period: float) -> float:
    sign = np.signbit(wave)
    crossings = np.flatnonzero(sign[1:] != sign[:-1])
    if crossings.size < 5:
        return 0.0
    spans = crossings[2:] - crossings[:-2]
    return float(np.tanh(0.3 * float(spans.mean()) / max(float(spans.std()), 1e-3 * period)))


def _rest_and_jumps(steps: Floats) -> tuple[float, float]:
    spread = max(float(np.std(steps)), 1e-12)
    size = np.abs(steps) / spread
    return float(np.mean(size < 0.15)), float(np.mean(size > 3.0))


def _area(u: Floats, y: Floats, period: float) -> float:
    """Mean signed area of PV against OP over a cycle, relative to that of an ellipse."""
    turning = np.sum(u[:-1] * np.diff(y) - y[:-1] * np.diff(u)) / 2.0
    return float(turning / (2.0 * np.pi * max(u.size / period, 1.0)))


def _yamashita(op: Floats, pv: Floats) -> float:
    """Share of moves in which OP moves and PV stands still."""
    op_moves, pv_moves = (
        np.abs(np.diff(signal)) >= 0.3 * float(np.std(np.diff(signal))) for signal in (op, pv)
    )
    moves = op_moves | pv_moves
    return float(np.mean((op_moves & ~pv_moves)[moves])) if moves.any() else 0.0
