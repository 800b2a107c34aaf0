"""The closed loop in continuous time, one small step after the other.

Order within a step: the archive reads, the controller scans, the air moves, the stem moves, the
process moves. Everything is SI inside the valve and percent outside it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from stemwatch.models.recording import Floats


class StemNumbers(NamedTuple):
    """Force balance of the stem. ``kinetic_n`` may be negative: see ``Valve``."""

    mass_kg: float
    spring_n_per_m: float
    stroke_m: float
    kinetic_n: float
    breakaway_n: float
    viscous_n_s_per_m: float
    stribeck_m_per_s: float
    rest_band_m_per_s: float  # below this speed the stem counts as standing (Karnopp)


class AirNumbers(NamedTuple):
    """Positioner and actuator chamber."""

    area_m2: float
    low_pa: float
    high_pa: float
    supply_pa: float
    lag_s: float
    positioner_gain: float


class ProcessNumbers(NamedTuple):
    """See ``Process``; ``balance`` is the travel at which PV stands still."""

    gain: float
    lag_s: float
    second_lag_s: float
    integrating: bool
    balance_percent: float
    pv_percent: float


class ControllerNumbers(NamedTuple):
    """See ``Controller``."""

    gain: float
    reset_s: float
    derivative_s: float
    scan_s: float
    low: float
    high: float
    output: float


class Steps(NamedTuple):
    """Whole numbers of steps."""

    total: int
    scan: int
    load: int
    record: int
    record_phase: int
    valve_delay: int
    process_delay: int


@njit(cache=True)
def friction_level(speed: float, breakaway_n: float, stem: StemNumbers) -> float:
    """Stribeck: ``Fc + (Fs - Fc) exp(-(v/vs)^2)``, newton."""
    ratio = speed / stem.stribeck_m_per_s
    if abs(ratio) > 6.0:  # exp(-36) is below the resolution of the forces
        return stem.kinetic_n
    return stem.kinetic_n + (breakaway_n - stem.kinetic_n) * math.exp(-ratio * ratio)


@njit(cache=True)
def stem_speed(
    force: float, speed: float, breakaway_n: float, dt: float, stem: StemNumbers
) -> float:
    """Speed after one step: Karnopp's standing band, drag implicit; a reversal within the step
    ends at rest, for the stem would otherwise never stick again."""
    standing = abs(speed) <= stem.rest_band_m_per_s
    if standing and abs(force) <= breakaway_n:
        return 0.0
    direction = math.copysign(1.0, force if standing else speed)
    net = force - direction * friction_level(speed, breakaway_n, stem)
    new = (speed + dt / stem.mass_kg * net) / (1.0 + dt * stem.viscous_n_s_per_m / stem.mass_kg)
    if new * direction < 0.0:
        return 0.0
    return new


@njit(cache=True)
def air_step(pressure: float, command: float, position: float, dt: float, air: AirNumbers) -> float:
    """Chamber pressure after one step, Pa; ``command`` and ``position`` in percent."""
    asked = command + air.positioner_gain * (command - position)
    target = air.low_pa + asked / 100.0 * (air.high_pa - air.low_pa)
    target = min(max(target, 0.0), air.supply_pa)
    if air.lag_s <= dt:
        return target
    return pressure + dt / air.lag_s * (target - pressure)


@njit(cache=True)
def controller_scan(
    error: float,
    slope: float,
    integral: float,
    automatic: bool,
    manual: float,
    c: ControllerNumbers,
) -> tuple[float, float]:
    """(OP, integral) after one scan; ``slope`` is the filtered rate of change of PV, %/s.

    The integral is set to what the output in force implies, at a limit and in manual alike, so
    that leaving either is bumpless.
    """
    if automatic:
        integral += c.gain * c.scan_s / c.reset_s * error
        wanted = c.gain * (error - c.derivative_s * slope) + integral
    else:
        wanted = manual
    output = min(max(wanted, c.low), c.high)
    if output != wanted or not automatic:
        integral = output - c.gain * (error - c.derivative_s * slope)
    return output, integral


@njit(cache=True)
def process_step(
    inflow: float, first: float, second: float, dt: float, process: ProcessNumbers
) -> tuple[float, float]:
    """Both states after one step, percent of PV away from balance; ``inflow`` in percent."""
    push = process.gain * inflow
    first += dt * push if process.integrating else dt / process.lag_s * (push - first)
    if process.second_lag_s <= dt:
        return first, first
    return first, second + dt / process.second_lag_s * (first - second)


@njit(cache=True)
def within_stroke(x: float, moved: float, stroke_m: float) -> tuple[float, float]:
    """Position and speed after the mechanical stops, which take all speed."""
    if x <= 0.0 or x >= stroke_m:
        return min(max(x, 0.0), stroke_m), 0.0
    return x, moved


@njit(cache=True)
def run_loop(
    dt: float,
    steps: Steps,
    stem: StemNumbers,
    air: AirNumbers,
    process: ProcessNumbers,
    controller: ControllerNumbers,
    set_point: Floats,
    manual: Floats,
    pv_noise: Floats,
    load: Floats,
    scatter: Floats,
) -> tuple[Floats, int]:
    """Simulate ``steps.total`` steps of ``dt`` seconds from balance at rest.

    ``set_point``, ``manual`` (OP in manual, NaN in automatic, +inf to hold the last OP) and
    ``pv_noise`` hold one value per controller scan, ``load`` one per ``steps.load`` steps,
    ``scatter`` the relative deviation of successive breakaway levels (used in turn).

    Returns ``(records, standings)``: (m, 4) stem position, OP, PV as the controller read it, PV
    without noise, all percent, and the number of times the stem came to rest.
    """
    count = (steps.total - steps.record_phase + steps.record - 1) // steps.record
    records = np.empty((count, 4))
    outputs = np.full(set_point.size, controller.output, dtype=np.float64)
    delay_line = np.full(steps.process_delay + 1, controller.output, dtype=np.float64)
    x = controller.output / 100.0 * stem.stroke_m
    pressure = air.low_pa + controller.output / 100.0 * (air.high_pa - air.low_pa)
    v, level = 0.0, stem.breakaway_n
    first, second = 0.0, 0.0
    op = controller.output
    integral = op - controller.gain * (set_point[0] - process.pv_percent)
    pv, read, filtered = process.pv_percent, process.pv_percent, process.pv_percent
    scan, record, standings, slot = 0, 0, 0, 0
    for i in range(steps.total):
        if i % steps.record == steps.record_phase:
            records[record] = (100.0 * x / stem.stroke_m, op, read, pv)
            record += 1
        if i % steps.scan == 0:
            read = min(max(pv + pv_noise[scan], 0.0), 100.0)
            blend = controller.scan_s / (controller.scan_s + controller.derivative_s / 8.0)
            slope = blend * (read - filtered) / controller.scan_s
            filtered += blend * (read - filtered)
            hold = op if np.isinf(manual[scan]) else manual[scan]
            automatic = np.isnan(manual[scan])
            op, integral = controller_scan(
                set_point[scan] - read, slope, integral, automatic, hold, controller
            )
            outputs[scan] = op
            scan += 1
        command = controller.output
        if i >= steps.valve_delay:
            command = outputs[(i - steps.valve_delay) // steps.scan]
        pressure = air_step(pressure, command, 100.0 * x / stem.stroke_m, dt, air)
        force = air.area_m2 * (pressure - air.low_pa) - stem.spring_n_per_m * x
        moved = stem_speed(force, v, level, dt, stem)
        x, moved = within_stroke(x + dt * moved, moved, stem.stroke_m)
        if moved == 0.0 and v != 0.0:
            deviation = scatter[standings % scatter.size]
            level = max(stem.breakaway_n * (1.0 + deviation), stem.kinetic_n)
            standings += 1
        v = moved
        delayed = delay_line[slot]
        delay_line[slot] = 100.0 * x / stem.stroke_m
        slot = slot + 1 if slot < steps.process_delay else 0
        inflow = delayed - process.balance_percent + load[i // steps.load]
        first, second = process_step(inflow, first, second, dt, process)
        pv = process.pv_percent + second
    return records, standings
