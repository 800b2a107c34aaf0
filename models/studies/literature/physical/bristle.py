"""Kernel of a stem on bristles: LuGre friction, and Dahl's as its special case.

``g(v) = (Fc + (Fs - Fc) exp(-(v/vs)^2))/s0``, ``z' = v - |v| z/g``, ``Ff = s0 z + s1 z' + Fv v``.
Dahl's is LuGre with Fs = Fc and s1 = 0. The bristles are more than a hundred times stiffer than the
spring; position, velocity and deflection are therefore advanced together by the linearly implicit
Euler rule, a full step against two half steps, extrapolated to second order, with the step
controlled by their difference. The 3 by 3 system is solved in closed form.

Order of ``c`` (11,): mass, spring rate, static level, kinetic level, viscous coefficient, Stribeck
speed, bristle stiffness, bristle damping, tolerance of position (m), force at u = 0, force per
percent of u. All in SI units.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.model import Run
from stemwatch.models.studies.literature.physical.body import Packing, ValveBody
from stemwatch.models.studies.literature.physical.published import ParameterSet
from stemwatch.models.studies.literature.physical.shared_parameters import actuator_force

MASS, SPRING, STATIC, KINETIC, VISCOUS, STRIBECK, STIFFNESS, DAMPING = range(8)
TOLERANCE, FORCE, FORCE_PER_PERCENT = range(8, 11)
N_CONSTANTS = 11


@compiled()
def _euler(
    x: float, v: float, z: float, h: float, force: float, c: Floats
) -> tuple[float, float, float]:
    """One linearly implicit step of ``h`` s under the actuator force at its end."""
    drop = (c[STATIC] - c[KINETIC]) * np.exp(-((v / c[STRIBECK]) ** 2))
    g = (c[KINETIC] + drop) / c[STIFFNESS]
    wear = abs(v) / g  # relaxation rate of the bristles, 1/s
    # d(wear)/dv, with g' = -2 v drop / (vs^2 s0)
    d_wear = np.sign(v) / g + abs(v) * 2.0 * v * drop / (
        c[STRIBECK] * c[STRIBECK] * c[STIFFNESS] * g * g
    )
    z_dot = v - wear * z
    z_by_v = 1.0 - z * d_wear
    net = force - c[SPRING] * x - c[STIFFNESS] * z - c[DAMPING] * z_dot - c[VISCOUS] * v
    by_z = -c[STIFFNESS] + c[DAMPING] * wear
    by_v = -c[DAMPING] * z_by_v - c[VISCOUS]
    fade = 1.0 + h * wear
    coupling = by_v + h * by_z * z_by_v / fade - h * c[SPRING]
    right = net - h * c[SPRING] * v + h * by_z * z_dot / fade
    dv = h * right / max(c[MASS] - h * coupling, 0.5 * c[MASS])
    dz = h * (z_dot + z_by_v * dv) / fade
    return x + h * (v + dv), v + dv, z + dz


@compiled()
def _interval(
    x: float, v: float, z: float, h: float, f0: float, rate: float, length: float, c: Floats
) -> tuple[float, float, float, float]:
    """State and next step after one sampling interval of ``length`` s, begun with step ``h``."""
    t, least = 0.0, 1e-9 * length
    # Errors of z count as the spring travel that their force would cause, those of v as the travel
    # within one radian of the free swing.
    swing_s, lever = np.sqrt(c[MASS] / c[SPRING]), c[STIFFNESS] / (c[SPRING] + c[STIFFNESS])
    while length - t > least:
        h = max(min(h, length - t), least)
        f1 = f0 + rate * (t + h)
        x1, v1, z1 = _euler(x, v, z, h, f1, c)
        xm, vm, zm = _euler(x, v, z, 0.5 * h, f0 + rate * (t + 0.5 * h), c)
        x2, v2, z2 = _euler(xm, vm, zm, 0.5 * h, f1, c)
        error = (abs(x2 - x1) + swing_s * abs(v2 - v1) + lever * abs(z2 - z1)) / c[TOLERANCE]
        if error > 1.0 and h > 2.0 * least:
            h *= max(0.9 / np.sqrt(error), 0.1)
            continue
        t += h
        x, v, z = 2.0 * x2 - x1, 2.0 * v2 - v1, 2.0 * z2 - z1
        h *= min(5.0, 0.9 / np.sqrt(error + 1e-12))
    return x, v, z, h


@compiled()
def run_bristle(
    op: Floats, interval_s: float, stroke_m: float, y0: float, c: Floats, out: Floats
) -> None:
    """Stem position (n,) in percent of ``stroke_m`` into ``out``, from rest at ``y0`` percent.

    ``op`` (n,) percent is linear between samples. At the start the bristles carry the force that
    the spring does not balance, up to their limit: a start from rest.
    """
    x, v = 0.01 * y0 * stroke_m, 0.0
    most_deflection = c[STATIC] / c[STIFFNESS]
    z = min(
        max(
            (c[FORCE] + c[FORCE_PER_PERCENT] * op[0] - c[SPRING] * x) / c[STIFFNESS],
            -most_deflection,
        ),
        most_deflection,
    )
    h = 0.1 * interval_s
    out[0] = y0
    for k in range(1, op.size):
        f0 = c[FORCE] + c[FORCE_PER_PERCENT] * op[k - 1]
        rate = c[FORCE_PER_PERCENT] * (op[k] - op[k - 1]) / interval_s
        x, v, z, h = _interval(x, v, z, h, f0, rate, interval_s, c)
        out[k] = 100.0 * x / stroke_m


def bristle_constants(body: ValveBody, packing: Packing, tolerance_percent: float) -> Floats:
    """(11,) constants in the order of this module."""
    c = np.empty(N_CONSTANTS)
    c[MASS], c[SPRING] = body.mass_kg, body.spring_n_per_m
    c[STATIC], c[KINETIC] = packing.static_n, packing.kinetic_n
    c[VISCOUS], c[STRIBECK] = packing.viscous_ns_per_m, packing.stribeck_m_per_s
    c[STIFFNESS], c[DAMPING] = packing.bristle_n_per_m, packing.bristle_ns_per_m
    c[TOLERANCE] = 0.01 * tolerance_percent * body.stroke_m
    c[FORCE], c[FORCE_PER_PERCENT] = actuator_force(body)
    return c


def bristle_run(
    valve: ParameterSet, packing_of_parameters: Callable[[Floats], Packing], tolerance: float
) -> Run:
    """The run of a model whose parameters make the packing; ``tolerance`` in percent."""

    def run(op: Floats, q: Floats, interval_s: float, y0: float, out: Floats) -> None:
        c = bristle_constants(valve.body, packing_of_parameters(q), tolerance)
        run_bristle(op, interval_s, valve.body.stroke_m, y0, c, out)

    return run
