"""Random signals that drive a simulated loop: noise of one or of all time scales, steps, waves.

Times are in scans.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter, sawtooth

from stemwatch.models.recording import Floats


def slewed(values: Floats, most_step: float) -> Floats:
    """The values behind a rate limit of ``most_step`` a scan."""
    followed = values.copy()
    for k in range(1, values.size):
        followed[k] = followed[k - 1] + np.clip(values[k] - followed[k - 1], -most_step, most_step)
    return followed


def coloured(count: int, time: float, rng: np.random.Generator) -> Floats:
    """(count,) noise of unit variance with this correlation time, in scans."""
    pole = float(np.exp(-1.0 / max(time, 0.05)))
    innovations = rng.standard_normal(count) * np.sqrt(1.0 - pole * pole)
    return np.asarray(lfilter([1.0], [1.0, -pole], innovations))


def many_scales(count: int, rng: np.random.Generator) -> Floats:
    """(count,) noise of about unit variance whose spectrum falls as one over the frequency."""
    times = times_of_many_scales(count)
    return np.asarray(sum(coloured(count, time, rng) for time in times) / np.sqrt(times.size))


def times_of_many_scales(count: int) -> Floats:
    """(6,) the correlation times that ``many_scales`` adds up, in scans."""
    return np.geomspace(1.0, max(count / 4.0, 8.0), 6)


def stepped(time: Floats, mean_gap: float, rng: np.random.Generator) -> Floats:
    """(n,) steps between -1 and 1, on average ``mean_gap`` scans from each other."""
    times = np.cumsum(mean_gap * (0.3 + 0.7 * rng.exponential(1.0, 4000)))
    times = times[times < time.size]
    heights = np.concatenate([[0.0], rng.uniform(-1.0, 1.0, times.size)])
    return np.asarray(heights[np.searchsorted(times, time, side="right")])


def now_and_then(count: int, mean_gap: float, rng: np.random.Generator) -> Floats:
    """(count,) ones, or in one record of four stretches of ones and noughts."""
    if rng.random() > 0.25:
        return np.ones(count)
    return np.asarray(coloured(count, mean_gap, rng) > rng.uniform(-0.7, 0.3), dtype=np.float64)


def wave(time: Floats, period: float, rng: np.random.Generator) -> Floats:
    """A sine, a triangle, a saw, or a wave between sine and square, whose phase wanders; now and
    then it comes and goes. Its period is drawn around ``period``."""
    own_period = period * float(np.exp(rng.uniform(np.log(0.7), np.log(6.0))))
    walk = np.cumsum(rng.standard_normal(time.size)) * np.sqrt(1.0 / own_period)
    phase = 2.0 * np.pi * (time / own_period + rng.uniform()) + rng.uniform(0.02, 0.5) * walk
    kind = rng.choice(["sine", "sine", "square", "triangle", "saw"])
    if kind == "sine":
        shape = np.sin(phase)
    elif kind == "square":
        shape = np.tanh(rng.uniform(1.5, 12.0) * np.sin(phase))
    else:
        shape = sawtooth(phase, 0.5 if kind == "triangle" else rng.uniform(0.55, 0.95))
    if rng.random() < 0.3:  # its amplitude wanders
        shape = shape * np.exp(0.4 * coloured(time.size, 5.0 * own_period, rng))
    return np.asarray(shape * now_and_then(time.size, 10.0 * own_period, rng))
