"""The compiled kernel of a closed loop in continuous time, in small fixed steps.

Order within a step: archive, controller, air, stem, process. SI units inside the valve, percent
outside it. What is called at each step is inlined, because passing all these numbers would take
longer than the step.
"""

from __future__ import annotations

import math

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.simulator.kernel_inputs import (
    AirLineNumbers,
    AirNumbers,
    BodyNumbers,
    ControllerNumbers,
    PackingNumbers,
    ProcessNumbers,
    StemNumbers,
    Steps,
    ValveNumbers,
)


@compiled()
def friction_level(speed: float, breakaway_n: float, kinetic_n: float, stem: StemNumbers) -> float:
    """Stribeck: ``Fc + (Fs - Fc) exp(-(v/vs)^2)``, newton."""
    ratio = speed / stem.stribeck_m_per_s
    if abs(ratio) > 6.0:  # exp(-36) is below the resolution of the forces
        return kinetic_n
    return kinetic_n + (breakaway_n - kinetic_n) * math.exp(-ratio * ratio)


@compiled(inline="always")
def stem_speed(
    force: float,
    speed: float,
    breakaway_n: float,
    kinetic_n: float,
    dt: float,
    stem: StemNumbers,
) -> float:
    """Speed after one step: Karnopp's standing band, drag implicit; a reversal within the step ends
    at rest, because the stem would otherwise never stick again.
    """
    is_standing = abs(speed) <= stem.rest_band_m_per_s
    if is_standing and abs(force) <= breakaway_n:
        return 0.0
    direction = math.copysign(1.0, force if is_standing else speed)
    net = force - direction * friction_level(speed, breakaway_n, kinetic_n, stem)
    new = (speed + dt / stem.mass_kg * net) / (1.0 + dt * stem.viscous_n_s_per_m / stem.mass_kg)
    if new * direction < 0.0:
        return 0.0
    return new


@compiled()
def bristle_speed(
    force: float,
    speed: float,
    deflection_m: float,
    breakaway_n: float,
    kinetic_n: float,
    dt: float,
    stem: StemNumbers,
    packing: PackingNumbers,
) -> tuple[float, float, float]:
    """(speed, deflection, way) after one step of LuGre friction.

    Canudas de Wit, Olsson, Astrom and Lischinsky (1995), doi:10.1109/9.376053. ``z' = v - s0 |v| z
    / g(v)`` and ``m v' = force - s0 z - s1 z' - c v``, both by the implicit Euler rule, in two
    halves of the step, because the bristles are stiff at a millisecond. ``g`` and ``|v|`` come from
    the last estimate of the speed, in three fixed-point iterations.
    """
    stiff, damp = packing.bristle_n_per_m, packing.bristle_n_s_per_m
    part = 0.5 * dt
    travel_m = 0.0
    for _ in range(2):
        new, slack = speed, 1.0
        for _ in range(3):
            level = max(friction_level(new, breakaway_n, kinetic_n, stem), 0.05 * breakaway_n)
            slack = 1.0 + part * stiff * abs(new) / level
            # z = (z0 + dt v)/slack, put into the balance of forces and solved for v.
            bristle_force = (
                stiff * deflection_m / slack + damp * deflection_m * (1.0 / slack - 1.0) / part
            )
            drag = stem.viscous_n_s_per_m + (stiff * part + damp) / slack
            new = speed + part / stem.mass_kg * (force - bristle_force)
            new /= 1.0 + part * drag / stem.mass_kg
        speed = new
        deflection_m = (deflection_m + part * speed) / slack
        travel_m += part * speed
    return speed, deflection_m, travel_m


@compiled(inline="always")
def packing_levels(
    opening: float,
    x: float,
    level_n: float,
    rest_s: float,
    factor: float,
    stem: StemNumbers,
    packing: PackingNumbers,
) -> tuple[float, float]:
    """(breakaway, kinetic) level in newton for motion towards ``opening`` (+1 or -1)."""
    breakaway = factor * (level_n + opening * packing.breakaway_skew_n)
    kinetic = factor * (stem.kinetic_n + opening * packing.kinetic_skew_n)
    if packing.bump_n > 0.0:
        offset = (x - packing.bump_at_m) / packing.bump_width_m
        tight = packing.bump_n * math.exp(-offset * offset)
        breakaway += tight
        kinetic += tight
    if packing.dwell_n > 0.0:
        if packing.dwell_settles:
            breakaway += packing.dwell_n * (1.0 - math.exp(-rest_s / packing.dwell_s))
        else:
            breakaway += packing.dwell_n * math.log(1.0 + rest_s / packing.dwell_s)
    return max(breakaway, kinetic), kinetic


@compiled(inline="always")
def plug_force(x: float, hysteresis: float, stem: StemNumbers, body: BodyNumbers) -> float:
    """Force on the stem in newton from the fluid, ``U (1 - sin(pi (x/stroke)^power))``, least where
    the plug takes the most flow; and from the inner friction of spring and diaphragm.
    """
    force = -body.hysteresis_n * hysteresis
    if body.flow_n != 0.0:
        opening = min(max(x / stem.stroke_m, 0.0), 1.0)
        force += body.flow_n * (1.0 - math.sin(math.pi * opening**body.flow_power))
    return force


@compiled(inline="always")
def moved_stem(
    force: float,
    x: float,
    v: float,
    level_n: float,
    factor: float,
    dt: float,
    valve: ValveNumbers,
    state: Floats,
) -> tuple[float, float]:
    """(position, speed) after one step with everything the packing and the body can do.

    ``state`` (3,) is carried on in place: time at rest in seconds, bristle deflection in metres,
    and the hysteresis of spring and diaphragm, -1 to 1.
    """
    stem, packing, body = valve.stem, valve.packing, valve.body
    force += plug_force(x, state[2], stem, body)
    was_standing = abs(v) <= stem.rest_band_m_per_s
    opening = math.copysign(1.0, force if was_standing else v)
    breakaway, kinetic = packing_levels(opening, x, level_n, state[0], factor, stem, packing)
    if packing.bristle_n_per_m > 0.0:
        moved, state[1], travel_m = bristle_speed(
            force, v, state[1], breakaway, kinetic, dt, stem, packing
        )
    else:
        moved = stem_speed(force, v, breakaway, kinetic, dt, stem)
        travel_m = dt * moved
    is_standing = abs(moved) <= stem.rest_band_m_per_s
    new = x + travel_m + (dt * packing.creep_m_per_s if is_standing else 0.0)
    if new <= body.low_m or new >= body.high_m:
        new, moved = min(max(new, body.low_m), body.high_m), 0.0
        is_standing = True
    state[0] = state[0] + dt if is_standing else 0.0
    travel_m = new - x
    if body.hysteresis_n > 0.0 and travel_m != 0.0:
        state[2] += travel_m / body.hysteresis_m * (1.0 - math.copysign(1.0, travel_m) * state[2])
    return new, moved


@compiled(inline="always")
def air_step(pressure: float, command: float, position: float, dt: float, air: AirNumbers) -> float:
    """Chamber pressure after one step, Pa; ``command`` and ``position`` in percent."""
    target = demanded_pressure(command, position, air)
    if air.lag_s <= dt:
        return target
    return pressure + dt / air.lag_s * (target - pressure)


@compiled(inline="always")
def demanded_pressure(command: float, position: float, air: AirNumbers) -> float:
    """The pressure that I/P or positioner demand, Pa, between 0 and the supply's."""
    demanded = command + air.positioner_gain * (command - position)
    target = air.low_pa + demanded / 100.0 * (air.high_pa - air.low_pa)
    return min(max(target, 0.0), air.supply_pa)


@compiled(inline="always")
def air_line_step(
    pressure: float,
    command: float,
    position: float,
    dt: float,
    air: AirNumbers,
    line: AirLineNumbers,
    state: Floats,
) -> float:
    """Chamber pressure after one step through a relay that rings, narrow ports, a weak supply.

    ``state`` (3,) is updated in place: the relay's pressure, its rate, and the drop of the supply,
    which falls with the air that fills the chamber and recovers by itself.
    """
    target = demanded_pressure(command, position, air)
    if line.ring_rad_per_s > 0.0:
        wn = line.ring_rad_per_s
        state[1] += dt * wn * (wn * (target - state[0]) - 2.0 * line.ring_damping * state[1])
        state[0] += dt * state[1]
        target = min(max(state[0], 0.0), air.supply_pa)
    target = max(target - state[2], 0.0)
    lag_s = air.lag_s if target > pressure else line.vent_lag_s
    change = (target - pressure) * (1.0 if lag_s <= dt else dt / lag_s)
    change = min(max(change, -dt * line.vent_pa_per_s), dt * line.fill_pa_per_s)
    state[2] += line.sag_share * max(change, 0.0) - dt / line.sag_s * state[2]
    return float(pressure + change)


@compiled()
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
        demanded = c.gain * (error - c.derivative_s * slope) + integral
    else:
        demanded = manual
    output = min(max(demanded, c.low), c.high)
    if output != demanded or not automatic:
        integral = output - c.gain * (error - c.derivative_s * slope)
    return output, integral


@compiled(inline="always")
def process_step(
    inflow: float, first: float, second: float, dt: float, process: ProcessNumbers
) -> tuple[float, float]:
    """Both states after one step, percent of PV away from balance; ``inflow`` in percent."""
    push = process.gain * inflow
    first += dt * push if process.integrating else dt / process.lag_s * (push - first)
    if process.second_lag_s <= dt:
        return first, first
    return first, second + dt / process.second_lag_s * (first - second)


@compiled(inline="always")
def within_stroke(x: float, moved: float, stroke_m: float) -> tuple[float, float]:
    """Position and speed after the mechanical stops, which take all speed."""
    if x <= 0.0 or x >= stroke_m:
        return min(max(x, 0.0), stroke_m), 0.0
    return x, moved


@compiled(inline="always")
def between(values: Floats, step: int, steps: int) -> float:
    """``values``, one per ``steps`` steps, on the straight line at ``step``."""
    index = min(step // steps, values.size - 2)
    return float(values[index] + (step / steps - index) * (values[index + 1] - values[index]))


@compiled(inline="always")
def valve_step(
    command: float,
    push_n: float,
    factor: float,
    pressure: float,
    x: float,
    v: float,
    level: float,
    dt: float,
    valve: ValveNumbers,
    line_state: Floats,
    stem_state: Floats,
) -> tuple[float, float, float]:
    """(pressure, position, speed) after one step: first the air, then the stem.

    ``push_n`` and ``factor`` are the upsets at this instant, ``level`` the breakaway level drawn
    when the stem last came to rest.
    """
    stem, air = valve.stem, valve.air
    position = 100.0 * x / stem.stroke_m
    if valve.line_on:
        pressure = air_line_step(pressure, command, position, dt, air, valve.line, line_state)
    else:
        pressure = air_step(pressure, command, position, dt, air)
    force = air.area_m2 * (pressure - air.low_pa) - stem.spring_n_per_m * x
    if valve.body_on:
        x, moved = moved_stem(force + push_n, x, v, level, factor, dt, valve, stem_state)
    else:
        moved = stem_speed(force, v, level, stem.kinetic_n, dt, stem)
        x, moved = within_stroke(x + dt * moved, moved, stem.stroke_m)
    return pressure, x, moved


@compiled()
def controller_reading(
    pv: float, filtered: float, c: ControllerNumbers
) -> tuple[float, float, float]:
    """(reading, its filtered rate of change in %/s, the filter's new state) at one scan."""
    read = min(max(pv, 0.0), 100.0)
    blend = c.scan_s / (c.scan_s + c.derivative_s / 8.0)
    slope = blend * (read - filtered) / c.scan_s
    return read, slope, filtered + blend * (read - filtered)


@compiled()
def controller_at_scan(
    pv: float,
    scan: Floats,
    output: float,
    filtered: float,
    integral: float,
    c: ControllerNumbers,
) -> tuple[float, float, float, float]:
    """(reading, the filter's new state, OP, integral) of one scan: ``scan`` (3,) holds set point,
    OP in manual (NaN in automatic, +inf to hold ``output``, the last OP) and noise of PV."""
    read, slope, filtered = controller_reading(pv + scan[2], filtered, c)
    automatic, manual = np.isnan(scan[1]), output if np.isinf(scan[1]) else scan[1]
    output, integral = controller_scan(scan[0] - read, slope, integral, automatic, manual, c)
    return read, filtered, output, integral


@compiled(inline="always")
def write_record(
    row: Floats, x: float, op: float, read: float, pv: float, linked: float, stroke_m: float
) -> None:
    """One row (5,) of the records of ``run_loop``."""
    # One by one: assigning a whole row would compile numba's error about shapes too.
    row[0], row[1], row[2] = 100.0 * x / stroke_m, op, read
    row[3], row[4] = pv, 100.0 * linked / stroke_m


@compiled()
def run_loop(
    dt: float,
    steps: Steps,
    valve: ValveNumbers,
    process: ProcessNumbers,
    c: ControllerNumbers,
    scans: Floats,
    load: Floats,
    upsets: Floats,
    scatter: Floats,
) -> tuple[Floats, int]:
    """Simulate ``steps.total`` steps of ``dt`` seconds from balance at rest.

    ``scans`` (3, s) hold what ``controller_at_scan`` takes at each scan; ``load`` one value per
    ``steps.load`` steps; ``upsets`` (2, l) the force on the stem in newton and the factor on
    friction, on the load's grid; ``scatter`` the relative deviation of successive breakaway levels
    (used in turn).

    Returns ``(records, standings)``: (m, 5) stem position, OP, PV as the controller read it, PV
    without noise, position that the sensor's linkage has, all percent, and the number of times
    the stem came to rest.
    """
    records = np.empty(((steps.total - steps.record_phase + steps.record - 1) // steps.record, 5))
    outputs = np.full(scans.shape[1], c.output)
    delay_line = np.full(steps.process_delay + 1, c.output)
    stem, air, body = valve.stem, valve.air, valve.body
    x = min(max(c.output / 100.0 * stem.stroke_m, body.low_m), body.high_m)
    pressure = air.low_pa + c.output / 100.0 * (air.high_pa - air.low_pa)
    v, level, linked, push, factor = 0.0, stem.breakaway_n, x, 0.0, 1.0
    line_state, stem_state = np.array([pressure, 0.0, 0.0]), np.zeros(3)
    op = command = c.output
    pv = read = filtered = process.pv_percent
    integral = op - c.gain * (scans[0, 0] - pv)
    first, second, scan, record, standings, slot = 0.0, 0.0, 0, 0, 0, 0
    # A Karnopp stem comes to rest at zero; bristles creep on for ever.
    rest_band = stem.rest_band_m_per_s if valve.packing.bristle_n_per_m > 0.0 else 0.0
    for i in range(steps.total):
        if i % steps.record == steps.record_phase:
            write_record(records[record], x, op, read, pv, linked, stem.stroke_m)
            record += 1
        if i % steps.scan == 0:
            read, filtered, op, integral = controller_at_scan(
                pv, scans[:, scan], op, filtered, integral, c
            )
            outputs[scan] = op
            scan += 1
        if i >= steps.valve_delay:
            command = outputs[(i - steps.valve_delay) // steps.scan]
        if valve.body_on:
            push = between(upsets[0], i, steps.load)
            factor = between(upsets[1], i, steps.load)
        pressure, x, moved = valve_step(
            command, push, factor, pressure, x, v, level, dt, valve, line_state, stem_state
        )
        if abs(moved) <= rest_band < abs(v):
            deviation = scatter[standings % scatter.size]
            level = max(stem.breakaway_n * (1.0 + deviation), stem.kinetic_n)
            standings += 1
        v = moved
        linked = min(max(linked, x - body.half_play_m), x + body.half_play_m)
        delayed = delay_line[slot]
        delay_line[slot] = 100.0 * x / stem.stroke_m
        slot = slot + 1 if slot < steps.process_delay else 0
        inflow = delayed - process.balance_percent + load[i // steps.load]
        first, second = process_step(inflow, first, second, dt, process)
        pv = process.pv_percent + second
    return records, standings
