"""The wave shapes by which the literature detects a sticking valve from OP and PV alone, as
numbers.

None of them decides: a trained network weighs them (``models.without_position.network``).
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.statistics.cross_correlation import lagged_products

NAMES = ("triangle beside sine, OP", "oddness of the correlation", "regularity of OP")


def wave_shapes(op: Floats, pv: Floats, period: float) -> Floats:
    """(3,) the shapes of ``op`` and ``pv`` (n,), block means over some 25 to a period.

    ``period`` is in samples of these. ``NAMES`` has what each is. Cross-correlation: Horch (1999),
    doi:10.1016/S0967-0661(99)00100-8. Triangle beside sine: He, Wang, Pottmann and Qin (2007),
    doi:10.1021/ie0609280.
    """
    u, y = banded(op, period), banded(pv, period)
    return np.array(
        [triangle_beside_sine(u, period), _oddness(u, y, period), _regularity(u, period)]
    )


def banded(values: Floats, period: float) -> Floats:
    """Between a third and six times the period's frequency, of unit size."""
    n = values.size
    line = np.linspace(values[0], values[-1], n)
    spectrum = np.fft.rfft(values - line)
    frequency = np.arange(spectrum.size) / n
    spectrum[(frequency < 0.33 / period) | (frequency > 6.0 / period)] = 0.0
    filtered = np.fft.irfft(spectrum, n)
    return np.asarray(filtered / max(float(np.std(filtered)), 1e-9))


@compiled(error_model="numpy")
def triangle_beside_sine(wave: Floats, period: float) -> float:
    """How much better triangles fit the half cycles than sines do, a log ratio."""
    sine = triangle = 1e-9
    start = 0
    for stop in range(1, wave.size):
        if np.signbit(wave[stop]) == np.signbit(wave[stop - 1]):
            continue
        count = stop - start
        if start > 0 and 4 <= count <= 2.0 * period:
            # Number by number: whole arrays take seconds to compile.
            part, as_sine, as_triangle = np.empty(count), np.empty(count), np.empty(count)
            highest = 0
            for i in range(count):
                part[i] = abs(wave[start + i])
                as_sine[i] = np.sin(np.pi * ((i + 0.5) / count))
                highest = i if part[i] > part[highest] else highest
            peak = min(max((highest + 0.5) / count, 0.15), 0.85)
            for i in range(count):
                time = (i + 0.5) / count
                as_triangle[i] = min(time / peak, (1.0 - time) / (1.0 - peak))
            sine += _misfit(part, as_sine)
            triangle += _misfit(part, as_triangle)
        start = stop
    return float(np.log(sine / triangle))


@compiled(error_model="numpy")
def _misfit(part: Floats, shape: Floats) -> float:
    product, square, missed = 0.0, 0.0, 0.0
    for i in range(part.size):
        product += part[i] * shape[i]
        square += shape[i] * shape[i]
    height = product / square
    for i in range(part.size):
        missed += (part[i] - height * shape[i]) ** 2
    return missed


def _oddness(u: Floats, y: Floats, period: float) -> float:
    """The odd share of the cross-correlation over half a period: 1 where it is all odd."""
    half = max(int(period) // 2, 2)
    forward = lagged_products(u, y, half)[1:half]
    backward = lagged_products(y, u, half)[1:half]
    even, odd_part = (
        float(np.sum((forward + backward) ** 2)),
        float(np.sum((forward - backward) ** 2)),
    )
    return odd_part / max(even + odd_part, 1e-12)


def _regularity(wave: Floats, period: float) -> float:
    sign = np.signbit(wave)
    crossings = np.flatnonzero(sign[1:] != sign[:-1])
    if crossings.size < 5:
        return 0.0
    spans = crossings[2:] - crossings[:-2]
    return float(np.tanh(0.3 * float(spans.mean()) / max(float(spans.std()), 1e-3 * period)))
