"""The compiled kernel of a control loop in scans: controller, air, stem, process, sensor.

All in percent. It is coarser than the simulator of ``models.studies.simulator`` (one step is a scan
of the controller, the stem has no mass) and hundreds of times quicker: a network is trained on
thousands of its loops. The stem has two force levels, of which the upper one is drawn anew at every
stop, behind an air lag.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats


class LoopNumbers(NamedTuple):
    """One loop as numbers. Times are in scans, all else in percent.

    ``S`` and ``J`` are the stem's; ``scatter`` the standard deviation of its breakaway level as a
    share of that; ``play`` lost motion of the PV sensor; ``step`` the smallest step of OP and PV;
    ``bend`` by how much the flow bends with travel, as a share per 10 %. The controller acts once
    in ``executes_every`` scans, on PV behind a lag ``pv_filter``, and on no error within ``gap``.
    """

    gain: float
    reset: float
    low: float
    high: float
    output: float
    air_lag: float
    S: float
    J: float
    scatter: float
    process_gain: float
    lag: float
    second_lag: float
    delay: int
    integrating: bool
    play: float
    sensor_lag: float
    op_step: float
    pv_step: float
    bend: float
    executes_every: int
    pv_filter: float
    gap: float


@compiled()
def _rounded(value: float, step: float) -> float:
    return round(value / step) * step if step > 0.0 else value


@compiled()
def _with_play(true: float, indicated: float, half_play: float) -> float:
    """What a sensor with lost motion shows."""
    return min(max(indicated, true - half_play), true + half_play)


@compiled()
def _controlled(numbers: LoopNumbers, error: float, integral: float) -> tuple[float, float]:
    """OP and the integral part of a PI controller that stops integrating at its limits."""
    if abs(error) < numbers.gap:
        error = 0.0
    integral += numbers.gain * error * numbers.executes_every / numbers.reset
    demanded = integral + numbers.gain * error
    op = min(max(demanded, numbers.low), numbers.high)
    return op, integral + op - demanded


@compiled()
def run_scans(
    numbers: LoopNumbers,
    set_point: Floats,
    load: Floats,
    push: Floats,
    noise: Floats,
    draws: Floats,
) -> tuple[Floats, Floats]:
    """(2, n) OP and PV as read at each scan, and (n,) the stem.

    ``set_point``, ``load`` (at the process input), ``push`` (on PV itself) and ``noise`` are (n,);
    ``draws`` are standard normal numbers for the breakaways, taken in turn.
    """
    n = set_point.size
    out = np.empty((2, n))
    stem = np.empty(n)
    fs0, fd = 0.5 * (numbers.S + numbers.J), 0.5 * (numbers.S - numbers.J)
    a_air = 1.0 - math.exp(-1.0 / numbers.air_lag) if numbers.air_lag > 0.05 else 1.0
    a_lag = 1.0 - math.exp(-1.0 / numbers.lag)
    a_second = 1.0 - math.exp(-1.0 / numbers.second_lag) if numbers.second_lag > 0.05 else 1.0
    a_sensor = 1.0 - math.exp(-1.0 / numbers.sensor_lag) if numbers.sensor_lag > 0.05 else 1.0
    op = p = x = numbers.output
    waiting = np.zeros(numbers.delay + 1)
    first = second = sensed = indicated = 0.0
    integral = numbers.output
    moving, side, fs, draws_used = False, 1.0, fs0, 0
    half_play = 0.5 * numbers.play
    base = set_point[0]
    a_filter = 1.0 - math.exp(-1.0 / numbers.pv_filter) if numbers.pv_filter > 0.05 else 1.0
    filtered = base
    for k in range(n):
        true = base + sensed + push[k]
        indicated = _with_play(true - base, indicated, half_play)
        pv = _rounded(base + indicated + noise[k], numbers.pv_step)
        filtered += a_filter * (pv - filtered)
        if k % numbers.executes_every == 0:
            op, integral = _controlled(numbers, set_point[k] - filtered, integral)
        op_read = _rounded(op, numbers.op_step)
        before = p
        p += a_air * (op_read - p)
        if moving and side * (p - before) <= 1e-9:
            moving = False
            fs = fs0 * max(1.0 + numbers.scatter * draws[draws_used % draws.size], 0.2)
            fs = max(fs, fd)
            draws_used += 1
        if not moving and abs(p - x) > fs:
            moving = True
            side = 1.0 if p > x else -1.0
        if moving:
            x = p - side * fd
        deviation = x - numbers.output
        bent = deviation * max(1.0 + 0.1 * numbers.bend * deviation, 0.2)
        waiting[k % waiting.size] = bent + load[k]
        entering = waiting[(k + 1) % waiting.size]
        if numbers.integrating:
            first += numbers.process_gain * entering / numbers.lag
        else:
            first += a_lag * (numbers.process_gain * entering - first)
        second += a_second * (first - second)
        sensed += a_sensor * (second - sensed)
        out[0, k], out[1, k] = op_read, pv
        stem[k] = x
    return out, stem
