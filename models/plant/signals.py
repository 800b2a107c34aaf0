"""What drives a simulated loop: set point, manual output, noise and load, as arrays in time."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from stemwatch.models.plant.loop import Load, LoadKind, ManualSpan, PlantLoop
from stemwatch.models.recording import Floats

LOAD_STEP_S = 0.1  # the load is held this long; ten times faster than any load drawn here


def set_point_at(loop: PlantLoop, times_s: Floats) -> Floats:
    """(n,) set point in percent: the last step at or before each time."""
    moves = sorted(loop.setpoints)
    starts = np.array([time for time, _ in moves], dtype=np.float64)
    heights = np.array([loop.controller.set_point, *(height for _, height in moves)])
    return np.asarray(heights[np.searchsorted(starts, times_s, side="right")], dtype=np.float64)


def manual_output_at(spans: tuple[ManualSpan, ...], times_s: Floats) -> Floats:
    """(n,) OP in manual; NaN in automatic, +inf where manual holds the last OP."""
    output = np.full(times_s.size, np.nan)
    for span in spans:
        inside = (times_s >= span.start_s) & (times_s < span.stop_s)
        output[inside] = np.inf
        if span.knots:
            times, heights = np.array(span.knots).T
            output[inside] = np.interp(times_s[inside], times, heights)
    return output


def load_at(loads: tuple[Load, ...], times_s: Floats, rng: np.random.Generator) -> Floats:
    """(n,) sum of the loads in percent of travel, on an even grid of ``times_s``."""
    total = np.zeros(times_s.size)
    for load in loads:
        total += _SHAPES[load.kind](load, times_s, rng)
    return total


def _coloured(load: Load, times_s: Floats, rng: np.random.Generator) -> Floats:
    pole = np.exp(-(times_s[1] - times_s[0]) / load.time_s)
    push = rng.standard_normal(times_s.size) * load.size * np.sqrt(1.0 - pole**2)
    push[0] = 0.0
    return np.asarray(lfilter([1.0], [1.0, -pole], push))


def _oscillating(load: Load, times_s: Floats, rng: np.random.Generator) -> Floats:
    step_s = times_s[1] - times_s[0]
    walk = np.cumsum(rng.standard_normal(times_s.size)) * np.sqrt(step_s / load.time_s)
    phase = 2.0 * np.pi * (times_s / load.time_s + rng.uniform()) + load.drift_rad * walk
    return np.asarray(load.size * np.sin(phase))


def _steps(load: Load, times_s: Floats, rng: np.random.Generator) -> Floats:
    span = times_s[-1] - times_s[0]
    count = 1 + rng.poisson(span / load.time_s)
    starts = np.sort(rng.uniform(times_s[0], times_s[-1], count))
    heights = np.concatenate([[0.0], rng.standard_normal(count) * load.size])
    return np.asarray(heights[np.searchsorted(starts, times_s, side="right")])


_SHAPES = {
    LoadKind.COLOURED: _coloured,
    LoadKind.OSCILLATING: _oscillating,
    LoadKind.STEPS: _steps,
}
