"""Inputs of a simulated loop as arrays over time: set point, manual output, load, and upsets."""

from __future__ import annotations

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.simulator.defects import Upsets
from stemwatch.models.studies.simulator.loop import Load, LoadKind, ManualSpan, PlantLoop

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
        in_manual = (times_s >= span.start_s) & (times_s < span.stop_s)
        output[in_manual] = np.inf
        if span.knots:
            times, heights = np.array(span.knots).T
            output[in_manual] = np.interp(times_s[in_manual], times, heights)
    return output


def load_at(loads: tuple[Load, ...], times_s: Floats, rng: np.random.Generator) -> Floats:
    """(n,) sum of the loads in percent of travel, on an even grid of ``times_s``."""
    total = np.zeros(times_s.size)
    for load in loads:
        total += _SHAPES[load.kind](load, times_s, rng)
    return total


def _coloured(load: Load, times_s: Floats, rng: np.random.Generator) -> Floats:
    pole = float(np.exp(-(times_s[1] - times_s[0]) / load.time_s))
    push = rng.standard_normal(times_s.size) * load.size * np.sqrt(1.0 - pole**2)
    push[0] = 0.0
    return _first_order(push, 1.0, pole)


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


_RAMP_S = 2.0  # rise time of a push by hand


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
        force += upsets.rough_percent * _unit_noise(times_s, upsets.rough_s, rng)
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


def _unit_noise(times_s: Floats, time_s: float, rng: np.random.Generator) -> Floats:
    """First-order noise of unit variance."""
    pole = float(np.exp(-(times_s[1] - times_s[0]) / time_s))
    return _first_order(rng.standard_normal(times_s.size), float(np.sqrt(1.0 - pole**2)), pole)


@compiled()
def _first_order(push: Floats, gain: float, pole: float) -> Floats:
    """(n,) ``y[k] = gain push[k] + pole y[k - 1]``, from rest.

    ``scipy.signal`` has this too, but takes longer to import than a plant to simulate.
    """
    out = np.empty(push.size)
    before = 0.0
    for k in range(push.size):
        out[k] = before + gain * push[k]
        before = out[k] * pole
    return out


def _episodes(times_s: Floats, every_s: float, lasts_s: float, rng: np.random.Generator) -> Floats:
    """(n,) trapezoids of height +1 or -1, one in each stretch of ``every_s``, at a random place."""
    starts = np.arange(0.0, times_s[-1], every_s)
    starts += rng.uniform(0.05, 0.95, starts.size) * max(every_s - lasts_s, 0.0)
    signs = rng.choice([-1.0, 1.0], starts.size)
    corners = starts[:, None] + np.array([0.0, _RAMP_S, lasts_s - _RAMP_S, lasts_s])
    heights = signs[:, None] * np.array([0.0, 1.0, 1.0, 0.0])
    return np.asarray(np.interp(times_s, corners.ravel(), heights.ravel()))
