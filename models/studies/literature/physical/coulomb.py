"""Kernel of a stem under Coulomb friction with a Stribeck drop: classical and Karnopp's form.

A resting stem is not integrated: within a sampling interval the pressure is taken as linear, so
that the instant of the breakaway has a closed form. A moving stem is integrated by the linearly
implicit Euler rule, a full step against two half steps, extrapolated to second order; the
difference of the two controls the step. The rule is stable for any viscous drag and any spring, so
that a smooth slide takes one step a sample and a slip takes as many as it needs. The instant at
which the velocity changes sign is found by shortening the step, and there the stem rests: a solver
with a fixed step cannot make this test ``v == 0``.

Order of ``c`` (12,): mass, spring rate, static level, kinetic level, viscous coefficient, Stribeck
speed, Karnopp's band, lower and upper stop (m), tolerance of position (m), force at u = 0, force
per percent of u. All in SI units.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import Run
from stemwatch.models.studies.literature.physical.body import Packing, ValveBody
from stemwatch.models.studies.literature.physical.published import ParameterSet
from stemwatch.models.studies.literature.physical.shared_parameters import (
    actuator_force,
    packing_of,
)

MASS, SPRING, STATIC, KINETIC, VISCOUS, STRIBECK = range(6)
BAND, STOP_LOW, STOP_HIGH, TOLERANCE, FORCE, FORCE_PER_PERCENT = range(6, 12)
N_CONSTANTS = 12


@compiled()
def _euler(
    x: float, v: float, h: float, force: float, side: float, c: Floats
) -> tuple[float, float]:
    """One linearly implicit step of ``h`` s under the actuator force at its end."""
    drop = (c[STATIC] - c[KINETIC]) * np.exp(-((v / c[STRIBECK]) ** 2))
    slope = 2.0 * abs(v) * drop / (c[STRIBECK] * c[STRIBECK]) - c[VISCOUS]
    net = force - c[SPRING] * x - side * (c[KINETIC] + drop) - c[VISCOUS] * v
    # A falling friction level is an unstable slope; beyond this value the step is too long anyway.
    slope = min(slope, 0.5 * c[MASS] / h)
    dv = h * (net - h * c[SPRING] * v) / (c[MASS] - h * slope + h * h * c[SPRING])
    return x + h * (v + dv), v + dv


@compiled()
def _step(
    x: float, v: float, h: float, f0: float, rate: float, side: float, c: Floats
) -> tuple[float, float, float]:
    """Position, velocity and error (1 is the tolerance) after ``h`` s; force ``f0 + rate t``."""
    x1, v1 = _euler(x, v, h, f0 + rate * h, side, c)
    xm, vm = _euler(x, v, 0.5 * h, f0 + 0.5 * rate * h, side, c)
    x2, v2 = _euler(xm, vm, 0.5 * h, f0 + rate * h, side, c)
    # Errors of the velocity count as the travel within one radian of the free swing.
    swing_s = np.sqrt(c[MASS] / c[SPRING])
    error = (abs(x2 - x1) + swing_s * abs(v2 - v1)) / c[TOLERANCE]
    return 2.0 * x2 - x1, 2.0 * v2 - v1, error


@compiled()
def _rests_for(x: float, f0: float, rate: float, c: Floats) -> float:
    """Seconds until a resting stem lets go, 0 if at once, infinity if never."""
    net = f0 - c[SPRING] * x
    up = net > c[STATIC] and x < c[STOP_HIGH]
    down = -net > c[STATIC] and x > c[STOP_LOW]
    if up or down:
        return 0.0
    wait_s = np.inf
    if rate > 0.0 and x < c[STOP_HIGH]:
        wait_s = (c[STATIC] - net) / rate
    elif rate < 0.0 and x > c[STOP_LOW]:
        wait_s = (c[STATIC] + net) / -rate
    return float(max(wait_s, 0.0))


@compiled()
def _interval(
    x: float, v: float, f0: float, rate: float, length: float, c: Floats
) -> tuple[float, float]:
    """Position and velocity after one sampling interval of ``length`` s."""
    t, h = 0.0, length
    least = 1e-12 * length
    # below this velocity the tolerance cannot distinguish motion from rest
    calm = c[TOLERANCE] / np.sqrt(c[MASS] / c[SPRING])
    side, resting = (1.0 if v > 0.0 else -1.0), v == 0.0
    while length - t > least:
        if resting:
            t += _rests_for(x, f0 + rate * t, rate, c)
            if length - t <= least:
                break
            net = f0 + rate * t - c[SPRING] * x
            side = 1.0 if net > 0.0 else -1.0
            h, resting = 1e-3, False
        h = min(h, length - t)
        xn, vn, error = _step(x, v, h, f0 + rate * t, rate, side, c)
        if error > 1.0 and h > least:
            h *= max(0.9 / np.sqrt(error), 0.1)
            continue
        if side * vn < -calm and side * v > calm and h > least:
            h *= max(v / (v - vn), 0.05)  # it came to rest within the step: where?
            continue
        t += h
        x, v = xn, vn
        force = abs(f0 + rate * t - c[SPRING] * x)
        if side * v <= 0.0 or (abs(v) <= c[BAND] and force <= c[STATIC]):
            v = 0.0
        if x >= c[STOP_HIGH] or x <= c[STOP_LOW]:
            x, v = min(max(x, c[STOP_LOW]), c[STOP_HIGH]), 0.0
        resting = v == 0.0
        h *= min(5.0, 0.9 / np.sqrt(error + 1e-12))
    return x, v


@compiled()
def run_coulomb(
    pressure: Floats, interval_s: float, stroke_m: float, y0: float, c: Floats, out: Floats
) -> None:
    """Stem position (n,) in percent of ``stroke_m`` into ``out``, from rest at ``y0`` percent.

    ``pressure`` (n,) is the actuator's in percent of OP, a straight line between samples.
    """
    x, v = 0.01 * y0 * stroke_m, 0.0
    out[0] = y0
    for k in range(1, pressure.size):
        f0 = c[FORCE] + c[FORCE_PER_PERCENT] * pressure[k - 1]
        rate = c[FORCE_PER_PERCENT] * (pressure[k] - pressure[k - 1]) / interval_s
        x, v = _interval(x, v, f0, rate, interval_s, c)
        out[k] = 100.0 * x / stroke_m


@compiled()
def air_lag(op: Floats, interval_s: float, lag_s: float, out: Floats) -> None:
    """First-order lag of the air, exact at the samples for an OP that is straight between them.

    ``p' = (u - p)/T``; ``out`` (n,) percent. With a ``lag_s`` of 0 it copies ``op`` (n,).
    """
    out[0] = op[0]
    if lag_s <= 0.0:
        for k in range(1, op.size):
            out[k] = op[k]
        return
    a = np.exp(-interval_s / lag_s)
    ramp = 1.0 - (1.0 - a) * lag_s / interval_s
    for k in range(1, op.size):
        out[k] = a * out[k - 1] + (1.0 - a) * op[k - 1] + ramp * (op[k] - op[k - 1])


def coulomb_constants(
    body: ValveBody, packing: Packing, band_m_per_s: float, tolerance_percent: float
) -> Floats:
    """(12,) constants in the order of this module; no stops."""
    c = np.empty(N_CONSTANTS)
    c[MASS], c[SPRING] = body.mass_kg, body.spring_n_per_m
    c[STATIC], c[KINETIC] = packing.static_n, packing.kinetic_n
    c[VISCOUS], c[STRIBECK] = packing.viscous_ns_per_m, packing.stribeck_m_per_s
    c[BAND] = band_m_per_s
    c[STOP_LOW], c[STOP_HIGH] = -np.inf, np.inf
    c[TOLERANCE] = 0.01 * tolerance_percent * body.stroke_m
    c[FORCE], c[FORCE_PER_PERCENT] = actuator_force(body)
    return c


def coulomb_run(valve: ParameterSet, band_m_per_s: float, tolerance_percent: float) -> Run:
    """The run of a model whose parameters are Fs, Fc and Fv."""

    def run(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
        packing = packing_of(q, valve.packing)
        c = coulomb_constants(valve.body, packing, band_m_per_s, tolerance_percent)
        run_coulomb(op, interval_s, valve.body.stroke_m, y0, c, out)

    return run
