"""A test by hand over the whole stroke: ramps, staircases with holds, steps."""

from __future__ import annotations

import numpy as np

from stemwatch.models.plant.hidden.effect import log_uniform
from stemwatch.models.plant.loop import ManualSpan

_LOW, _HIGH = 8.0, 92.0
_STEP_S = 0.5  # an operator's step is not instant
_START = 50.0


def some_manual(duration_s: float, warmup_s: float, rng: np.random.Generator) -> ManualSpan:
    """OP by hand through random moves between 8 and 92 %, all kinds in turn, to the end."""
    knots = [(-warmup_s, _START), (10.0, _START)]
    moves = (_ramp, _staircase, _step, _slow_ramp)
    place = int(rng.integers(len(moves)))
    while knots[-1][0] < duration_s:
        knots += moves[place % len(moves)](knots[-1], rng)
        place += 1
    return ManualSpan(start_s=-warmup_s, stop_s=duration_s + 60.0, knots=tuple(knots))


def _elsewhere(here: float, rng: np.random.Generator, least: float, most: float) -> float:
    """An opening ``least`` to ``most`` percent away, on the side where there is more room."""
    way = float(rng.uniform(least, most))
    up = here < 50.0 if rng.random() < 0.75 else here >= 50.0
    return float(np.clip(here + (way if up else -way), _LOW, _HIGH))


def _ramp(last: tuple[float, float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """There and part of the way back, at 0.3 to 2 %/s."""
    time, here = last
    rate = log_uniform(rng, 0.3, 2.0)
    there = _elsewhere(here, rng, 20.0, 60.0)
    back = there + 0.6 * (here - there)
    first = time + abs(there - here) / rate
    second = first + abs(back - there) / rate
    return [(first, there), (second, back), (second + float(rng.uniform(5.0, 40.0)), back)]


def _slow_ramp(last: tuple[float, float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """One way at 0.05 to 0.25 %/s, for at most five minutes."""
    time, here = last
    rate = log_uniform(rng, 0.05, 0.25)
    there = _elsewhere(here, rng, 10.0, 300.0 * rate + 10.0)
    return [(time + abs(there - here) / rate, there)]


def _staircase(last: tuple[float, float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """Three to eight steps of 2 to 8 % in one direction, each held 5 to 60 s."""
    time, here = last
    sign = 1.0 if here < 50.0 else -1.0
    stairs = []
    for _ in range(int(rng.integers(3, 9))):
        here = float(np.clip(here + sign * rng.uniform(2.0, 8.0), _LOW, _HIGH))
        stairs.append((time + _STEP_S, here))
        time += _STEP_S + log_uniform(rng, 5.0, 60.0)
        stairs.append((time, here))
    return stairs


def _step(last: tuple[float, float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """One step of 10 to 45 %, held 20 to 120 s."""
    time, here = last
    there = _elsewhere(here, rng, 10.0, 45.0)
    return [(time + _STEP_S, there), (time + _STEP_S + float(rng.uniform(20.0, 120.0)), there)]
