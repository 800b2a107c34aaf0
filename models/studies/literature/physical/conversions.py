"""From newtons to S and J in percent of OP, and where that holds.

``Fspan`` is ``Sa (Pmax - Pmin)``, the diaphragm's force over the whole of OP: S and J are what OP
has to do, not the stem. ``k stroke`` differs from it by the bench set; where a source converts with
that, hand in ``body.bench_set()``.

The limits were found by simulating Karnopp's model with full mass, as stated at each function.
"""

from __future__ import annotations

import math

from stemwatch.models.estimate import Estimate
from stemwatch.models.studies.literature.physical.body import Packing, ValveBody

# Below a ratio of 1 a slip swings past its place, exp(-pi zeta/sqrt(1 - zeta^2)) of J beyond it,
# which at 0.9 is still nothing; from about 20 on the drag lets the stem stick
# again before it is there. Measured 5.34, 12.79 and 7.83 % at ratios of 1.2 to 1.7, where the
# formula gives 5.34, 12.79 and 7.86; and 7.5 to 8.1 % for 7.86 at a ratio of 17.
LEAST_DAMPING, MOST_DAMPING = 0.9, 20.0
CREEPS_FROM_S = 0.3  # Fv/k from which a stem on a slow ramp creeps where a lighter one slips


def damping_ratio(body: ValveBody, packing: Packing) -> float:
    """zeta = Fv / (2 sqrt(m k)), without unit."""
    return packing.viscous_ns_per_m / (2.0 * math.sqrt(body.mass_kg * body.spring_n_per_m))


def slip_time_s(body: ValveBody, packing: Packing) -> float:
    """Fv/k in s: the time constant of a slip that the drag governs."""
    return packing.viscous_ns_per_m / body.spring_n_per_m


def jump_percent(body: ValveBody, packing: Packing, speed_percent_per_s: float) -> Estimate:
    """J = 100 (Fs - Fc) / Fspan, or 0 where the stem creeps, or the reason why neither holds.

    ``speed_percent_per_s`` is the speed of OP's ramp. Slower than the Stribeck speed and with Fv/k
    above 0.3 s the stem creeps (set b: J of 0.05 % or less was measured).
    """
    _check(speed_percent_per_s)
    zeta = damping_ratio(body, packing)
    if _slow(body, packing, speed_percent_per_s) and _creeps(body, packing):
        return Estimate(value=0.0, unit="%")
    if zeta >= MOST_DAMPING:
        return Estimate.unknown(
            f"the damping ratio of {zeta:.3g} is above {MOST_DAMPING:g}: the slip is overdamped "
            "and the stem may stick again before it has jumped (Fs - Fc); simulate it instead",
            unit="%",
        )
    if zeta < LEAST_DAMPING:
        return Estimate.unknown(
            f"the damping ratio of {zeta:.3g} is below {LEAST_DAMPING:g}: the slip swings past its "
            "place and J is more than (Fs - Fc); simulate it instead",
            unit="%",
        )
    return Estimate(
        value=100.0 * (packing.static_n - packing.kinetic_n) / body.pressure_span_n, unit="%"
    )


def band_percent(body: ValveBody, packing: Packing, speed_percent_per_s: float) -> Estimate:
    """S = 100 (Fs + Fc) / Fspan, or 200 Fs / Fspan where the stem creeps, or why neither holds.

    The first holds where the stem moves faster than the Stribeck speed before the reversal
    (measured 58.71 and 51.23 % where the formula gives 58.69 and 51.22); the second on slower ramps
    with Fv/k above 0.3 s (set b: measured 25.4 to 25.8, formula 25.3).
    """
    _check(speed_percent_per_s)
    span = body.pressure_span_n
    if not _slow(body, packing, speed_percent_per_s):
        return Estimate(value=100.0 * (packing.static_n + packing.kinetic_n) / span, unit="%")
    if _creeps(body, packing):
        return Estimate(value=200.0 * packing.static_n / span, unit="%")
    return Estimate.unknown(
        f"a stem with Fv/k of {slip_time_s(body, packing):.2g} s that moves slower than its "
        f"Stribeck speed ({_stribeck_percent_per_s(body, packing):.2g} %/s) goes in slips, and S "
        "depends on where among them the reversal falls; simulate it, or ask for a faster ramp",
        unit="%",
    )


def sliding_offset_percent(
    body: ValveBody, packing: Packing, speed_percent_per_s: float
) -> Estimate:
    """u - y of a stem that slides upward at a steady speed: (level(v) + Fv v)/Fspan, percent.

    ``level(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)``; it holds always (set b at 0.7 %/s: 12.86 %
    measured), but leaves out preload and gain of a ``body`` whose pressures do not fit its stroke.
    """
    _check(speed_percent_per_s)
    v = 0.01 * speed_percent_per_s * body.stroke_m
    drop = math.exp(-((v / packing.stribeck_m_per_s) ** 2))
    level = packing.kinetic_n + (packing.static_n - packing.kinetic_n) * drop
    force = level + packing.viscous_ns_per_m * v
    return Estimate(value=100.0 * force / body.pressure_span_n, unit="%")


def _check(speed_percent_per_s: float) -> None:
    if not (math.isfinite(speed_percent_per_s) and speed_percent_per_s > 0.0):
        raise ValueError(f"speed_percent_per_s must be positive, received {speed_percent_per_s}")


def _stribeck_percent_per_s(body: ValveBody, packing: Packing) -> float:
    return 100.0 * packing.stribeck_m_per_s / body.stroke_m


def _slow(body: ValveBody, packing: Packing, speed_percent_per_s: float) -> bool:
    return speed_percent_per_s < _stribeck_percent_per_s(body, packing)


def _creeps(body: ValveBody, packing: Packing) -> bool:
    return slip_time_s(body, packing) > CREEPS_FROM_S
