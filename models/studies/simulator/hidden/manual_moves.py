"""OP by hand: an operator's ramps, staircases and steps."""

from __future__ import annotations

import numpy as np

from stemwatch.models.studies.simulator.hidden.hidden_effect import log_uniform
from stemwatch.models.studies.simulator.loop import ManualSpan

_LOW, _HIGH = 8.0, 92.0
_STEP_S = 0.5  # duration of an operator's step
_START = 50.0


def draw_manual(duration_s: float, warmup_s: float, rng: np.random.Generator) -> ManualSpan:
    """OP by hand through random moves between 8 and 92 %, all kinds in turn, to the end."""
    knots = [(-warmup_s, _START), (10.0, _START)]
    moves = (_ramp, _staircase, _step, _slow_ramp)
    move_index = int(rng.integers(len(moves)))
    while knots[-1][0] < duration_s:
        knots += moves[move_index % len(moves)](knots[-1], rng)
        move_index += 1
    return ManualSpan(start_s=-warmup_s, stop_s=duration_s + 60.0, knots=tuple(knots))


def _elsewhere(level: float, rng: np.random.Generator, least: float, most_change: float) -> float:
    """An opening ``least`` to ``most_change`` percent away, three times in four towards 50 %."""
    change = float(rng.uniform(least, most_change))
    up = level < 50.0 if rng.random() < 0.75 else level >= 50.0
    return float(np.clip(level + (change if up else -change), _LOW, _HIGH))


def _ramp(last: tuple[float, float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """There and part of the way back, at 0.3 to 2 %/s."""
    time, level = last
    rate = log_uniform(rng, 0.3, 2.0)
    target = _elsewhere(level, rng, 20.0, 60.0)
    halfway_back = target + 0.6 * (level - target)
    first = time + abs(target - level) / rate
    second = first + abs(halfway_back - target) / rate
    return [
        (first, target),
        (second, halfway_back),
        (second + float(rng.uniform(5.0, 40.0)), halfway_back),
    ]


def _slow_ramp(last: tuple[float, float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """One way at 0.05 to 0.25 %/s, for at most five minutes."""
    time, level = last
    rate = log_uniform(rng, 0.05, 0.25)
    target = _elsewhere(level, rng, 10.0, 300.0 * rate + 10.0)
    return [(time + abs(target - level) / rate, target)]


def _staircase(last: tuple[float, float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """Three to eight steps of 2 to 8 % in one direction, each held 5 to 60 s."""
    time, level = last
    sign = 1.0 if level < 50.0 else -1.0
    stairs = []
    for _ in range(int(rng.integers(3, 9))):
        level = float(np.clip(level + sign * rng.uniform(2.0, 8.0), _LOW, _HIGH))
        stairs.append((time + _STEP_S, level))
        time += _STEP_S + log_uniform(rng, 5.0, 60.0)
        stairs.append((time, level))
    return stairs


def _step(last: tuple[float, float], rng: np.random.Generator) -> list[tuple[float, float]]:
    """One step of 10 to 45 %, held 20 to 120 s."""
    time, level = last
    target = _elsewhere(level, rng, 10.0, 45.0)
    return [(time + _STEP_S, target), (time + _STEP_S + float(rng.uniform(20.0, 120.0)), target)]
