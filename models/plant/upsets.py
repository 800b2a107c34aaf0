"""What changes with time in a valve, as arrays on the load's grid."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from stemwatch.models.plant.defects import Upsets
from stemwatch.models.recording import Floats

_RAMP_S = 2.0  # a push by hand is not there at once


def upsets_at(
    upsets: Upsets, times_s: Floats, duration_s: float, rng: np.random.Generator
) -> Floats:
    """(2, n) force on the stem in percent of the spring range, and the factor on friction.

    ``times_s`` (n,) is an even grid that counts from the start of the recording; growth begins
    there and is complete after ``duration_s``.
    """
    force = np.zeros(times_s.size)
    factor = np.ones(times_s.size)
    if upsets.vibration_percent != 0.0:
        phase = 2.0 * np.pi * (upsets.vibration_hz * times_s + rng.uniform())
        force += upsets.vibration_percent * np.sin(phase)
    if upsets.rough_percent != 0.0:
        force += upsets.rough_percent * _coloured(times_s, upsets.rough_s, rng)
    if upsets.push_percent != 0.0:
        pushes = _episodes(times_s, upsets.push_every_s, upsets.push_lasts_s, rng)
        force += upsets.push_percent * pushes
    if upsets.growth != 0.0:
        factor *= 1.0 + upsets.growth * np.clip(times_s / duration_s, 0.0, 1.0)
    if upsets.wave != 0.0:
        factor *= 1.0 + upsets.wave * np.sin(
            2.0 * np.pi * (times_s / upsets.wave_s + rng.uniform())
        )
    if upsets.binding != 1.0:
        tight = _episodes(times_s, upsets.binding_every_s, upsets.binding_lasts_s, rng)
        factor *= 1.0 + (upsets.binding - 1.0) * np.abs(tight)
    return np.stack([force, factor])


def _coloured(times_s: Floats, time_s: float, rng: np.random.Generator) -> Floats:
    """First-order noise of unit variance."""
    pole = float(np.exp(-(times_s[1] - times_s[0]) / time_s))
    return np.asarray(
        lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.standard_normal(times_s.size))
    )


def _episodes(times_s: Floats, every_s: float, lasts_s: float, rng: np.random.Generator) -> Floats:
    """(n,) trapezoids of height +1 or -1, one in each stretch of ``every_s``, at a random place."""
    starts = np.arange(0.0, times_s[-1], every_s)
    starts += rng.uniform(0.05, 0.95, starts.size) * max(every_s - lasts_s, 0.0)
    signs = rng.choice([-1.0, 1.0], starts.size)
    corners = starts[:, None] + np.array([0.0, _RAMP_S, lasts_s - _RAMP_S, lasts_s])
    heights = signs[:, None] * np.array([0.0, 1.0, 1.0, 0.0])
    return np.asarray(np.interp(times_s, corners.ravel(), heights.ravel()))
