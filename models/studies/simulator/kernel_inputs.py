"""From the nameplates in percent to the numbers of the kernel, SI inside the valve.

Every number becomes a float: an integer would make the kernel count in whole percent.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from stemwatch.models.studies.simulator.defects import AirLine, BodyDefects, PackingDefects, Upsets
from stemwatch.models.studies.simulator.loop import PlantLoop
from stemwatch.models.studies.simulator.valve import Actuator, SimulatedValve


class StemNumbers(NamedTuple):
    """Force balance of the stem. ``kinetic_n`` may be negative: see ``SimulatedValve``."""

    mass_kg: float
    spring_n_per_m: float
    stroke_m: float
    kinetic_n: float
    breakaway_n: float
    viscous_n_s_per_m: float
    stribeck_m_per_s: float
    rest_band_m_per_s: float  # below this speed the stem counts as standing (Karnopp)


class PackingNumbers(NamedTuple):
    """Friction beyond two levels; see ``PackingDefects``. All zero is neutral."""

    breakaway_skew_n: float  # added to the breakaway level when opening, taken off when closing
    kinetic_skew_n: float
    bump_n: float
    bump_at_m: float
    bump_width_m: float
    dwell_n: float
    dwell_s: float
    dwell_settles: bool
    creep_m_per_s: float
    bristle_n_per_m: float  # above zero: LuGre in place of Karnopp
    bristle_n_s_per_m: float


class BodyNumbers(NamedTuple):
    """Stops, forces on the plug and in the spring, and play in front of the position sensor."""

    low_m: float
    high_m: float
    flow_n: float
    flow_power: float  # the flow force is least where (x/stroke)^power is one half
    hysteresis_n: float
    hysteresis_m: float
    half_play_m: float


class AirNumbers(NamedTuple):
    """Positioner and actuator chamber."""

    area_m2: float
    low_pa: float
    high_pa: float
    supply_pa: float
    lag_s: float
    positioner_gain: float


class AirLineNumbers(NamedTuple):
    """Air line between positioner and chamber beyond one lag; see ``AirLine``."""

    vent_lag_s: float
    fill_pa_per_s: float
    vent_pa_per_s: float
    ring_rad_per_s: float
    ring_damping: float
    sag_share: float
    sag_s: float


class ValveNumbers(NamedTuple):
    """A valve. Where ``line_on`` or ``body_on`` is False, the kernel computes air or stem the short
    way: one lag, two friction levels, no upsets."""

    stem: StemNumbers
    packing: PackingNumbers
    body: BodyNumbers
    air: AirNumbers
    line: AirLineNumbers
    line_on: bool
    body_on: bool


class ProcessNumbers(NamedTuple):
    """``Process`` as the kernel takes it; ``balance_percent`` is the travel at which PV stands
    still."""

    gain: float
    lag_s: float
    second_lag_s: float
    integrating: bool
    balance_percent: float
    pv_percent: float


class ControllerNumbers(NamedTuple):
    """``Controller`` as the kernel takes it; ``low``, ``high`` and ``output`` in percent of OP."""

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


# Far below the Stribeck speed and far above the rounding of speeds, percent of travel per second.
_REST_BAND_PERCENT_PER_S = 1e-5
# Bristles creep on for ever; below this speed the stem counts as at rest.
_BRISTLE_REST_PERCENT_PER_S = 2e-3
_BRISTLE_DAMPING = 1.0  # of the critical one


def _newton_per_percent(actuator: Actuator) -> float:
    return actuator.spring_range_n / 100.0


def _metre_per_percent(actuator: Actuator) -> float:
    return actuator.stroke_m / 100.0


def _pascal_per_percent(actuator: Actuator) -> float:
    return (actuator.bench_high_pa - actuator.bench_low_pa) / 100.0


def stem_numbers(valve: SimulatedValve) -> StemNumbers:
    """Friction of ``valve``: ``Fs = (S + J)/2`` and ``Fc = (S - J)/2`` of spring range, newton."""
    actuator = valve.actuator
    newton, metre = _newton_per_percent(actuator), _metre_per_percent(actuator)
    bristles = valve.packing.presliding_percent > 0.0
    rest_band = _BRISTLE_REST_PERCENT_PER_S if bristles else _REST_BAND_PERCENT_PER_S
    return StemNumbers(
        mass_kg=float(actuator.mass_kg),
        spring_n_per_m=actuator.spring_n_per_m,
        stroke_m=float(actuator.stroke_m),
        kinetic_n=0.5 * (valve.S - valve.J) * newton,
        breakaway_n=0.5 * (valve.S + valve.J) * newton,
        viscous_n_s_per_m=actuator.viscous_s * actuator.spring_n_per_m,
        stribeck_m_per_s=actuator.stribeck_percent_per_s * metre,
        rest_band_m_per_s=rest_band * metre,
    )


def packing_numbers(valve: SimulatedValve) -> PackingNumbers:
    """Friction of ``valve`` beyond its two levels."""
    packing = valve.packing
    newton, metre = _newton_per_percent(valve.actuator), _metre_per_percent(valve.actuator)
    S_half, J_half = 0.5 * valve.S * packing.S_skew, 0.5 * valve.J * packing.J_skew
    stiff = 0.0
    if packing.presliding_percent > 0.0:
        stiff = 0.5 * (valve.S + valve.J) * newton / (packing.presliding_percent * metre)
    return PackingNumbers(
        breakaway_skew_n=(S_half + J_half) * newton,
        kinetic_skew_n=(S_half - J_half) * newton,
        bump_n=packing.bump_percent * newton,
        bump_at_m=packing.bump_at_percent * metre,
        bump_width_m=packing.bump_width_percent * metre,
        dwell_n=packing.dwell_percent * newton,
        dwell_s=float(packing.dwell_s),
        dwell_settles=packing.dwell_settles,
        creep_m_per_s=packing.creep_percent_per_s * metre,
        bristle_n_per_m=stiff,
        bristle_n_s_per_m=_BRISTLE_DAMPING * 2.0 * math.sqrt(stiff * valve.actuator.mass_kg),
    )


def body_numbers(loop: PlantLoop) -> BodyNumbers:
    """Stops, forces on the plug and in the spring, and the play in front of the sensor."""
    body, actuator = loop.valve.body, loop.valve.actuator
    newton, metre = _newton_per_percent(actuator), _metre_per_percent(actuator)
    return BodyNumbers(
        low_m=body.low_percent * metre,
        high_m=body.high_percent * metre,
        flow_n=body.flow_percent * newton,
        flow_power=math.log(0.5) / math.log(body.flow_peak_percent / 100.0),
        hysteresis_n=body.hysteresis_percent * newton,
        hysteresis_m=body.hysteresis_way_percent * metre,
        half_play_m=0.5 * loop.transmitters.position_play * metre,
    )


def air_numbers(valve: SimulatedValve) -> AirNumbers:
    """Positioner and chamber of ``valve``."""
    actuator = valve.actuator
    return AirNumbers(
        area_m2=float(actuator.area_m2),
        low_pa=float(actuator.bench_low_pa),
        high_pa=float(actuator.bench_high_pa),
        supply_pa=float(actuator.supply_pa),
        lag_s=float(actuator.air_lag_s),
        positioner_gain=float(valve.positioner_gain),
    )


def air_line_numbers(valve: SimulatedValve) -> AirLineNumbers:
    """Air line of ``valve`` beyond one lag."""
    line, pascal = valve.air_line, _pascal_per_percent(valve.actuator)
    fill, vent = (
        math.inf if rate is None else rate * pascal
        for rate in (line.fill_percent_per_s, line.vent_percent_per_s)
    )
    vent_lag = valve.actuator.air_lag_s if line.vent_lag_s is None else line.vent_lag_s
    return AirLineNumbers(
        vent_lag_s=float(vent_lag),
        fill_pa_per_s=fill,
        vent_pa_per_s=vent,
        ring_rad_per_s=float(line.ring_rad_per_s),
        ring_damping=float(line.ring_damping),
        sag_share=float(line.sag_share),
        sag_s=float(line.sag_s),
    )


def valve_numbers(loop: PlantLoop) -> ValveNumbers:
    """The valve of ``loop``, and whether the kernel needs the full air line and the full body."""
    valve = loop.valve
    no_defects = (PackingDefects(), BodyDefects(), Upsets())
    return ValveNumbers(
        stem=stem_numbers(valve),
        packing=packing_numbers(valve),
        body=body_numbers(loop),
        air=air_numbers(valve),
        line=air_line_numbers(valve),
        line_on=valve.air_line != AirLine(),
        body_on=(valve.packing, valve.body, loop.upsets) != no_defects,
    )


def process_numbers(loop: PlantLoop) -> ProcessNumbers:
    """The process, in balance at the controller's set point and output."""
    return ProcessNumbers(
        gain=float(loop.process.gain),
        lag_s=float(loop.process.lag_s),
        second_lag_s=float(loop.process.second_lag_s),
        integrating=loop.process.integrating,
        balance_percent=float(loop.controller.output),
        pv_percent=float(loop.controller.set_point),
    )


def controller_numbers(loop: PlantLoop) -> ControllerNumbers:
    """The controller's settings."""
    c = loop.controller
    return ControllerNumbers(
        gain=float(c.gain),
        reset_s=float(c.reset_s),
        derivative_s=float(c.derivative_s),
        scan_s=float(c.scan_s),
        low=float(c.output_low),
        high=float(c.output_high),
        output=float(c.output),
    )
