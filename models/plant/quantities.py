"""The numbers that the compiled kernel works with: SI inside the valve, percent outside it."""

from __future__ import annotations

from typing import NamedTuple


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


class PackingNumbers(NamedTuple):
    """What makes friction more than two levels; see ``Packing``. All zero is neutral."""

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
    """What keeps the air from following with one lag; see ``AirLine``."""

    vent_lag_s: float
    fill_pa_per_s: float
    vent_pa_per_s: float
    ring_rad_per_s: float
    ring_damping: float
    sag_share: float
    sag_s: float


class ValveNumbers(NamedTuple):
    """A valve. Where ``line_on`` or ``body_on`` is False, air or stem take the short way: one lag,
    two friction levels, no upsets."""

    stem: StemNumbers
    packing: PackingNumbers
    body: BodyNumbers
    air: AirNumbers
    line: AirLineNumbers
    line_on: bool
    body_on: bool


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
