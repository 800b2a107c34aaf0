"""Defects of a valve beyond one air lag and two friction levels; all are absent by default.

Forces and pressures are in percent of the spring range, like S and J; positions in percent of
travel.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class AirLine:
    """Air between command and chamber, beyond the lag ``Actuator.air_lag_s``.

    ``vent_lag_s`` is the time constant of venting where it differs from that of filling.
    ``fill_percent_per_s`` and ``vent_percent_per_s`` are the most that a restriction lets in and
    out. ``ring_rad_per_s`` and ``ring_damping`` are natural frequency and damping ratio of a relay
    that swings about its command; 0 is a relay without delay. ``sag_share`` is the loss of supply
    pressure for each percent by which the chamber rises, and ``sag_s`` its recovery time; the
    chamber pressure falls short by the same amount.
    """

    vent_lag_s: float | None = None
    fill_percent_per_s: float | None = None
    vent_percent_per_s: float | None = None
    ring_rad_per_s: float = 0.0
    ring_damping: float = 1.0
    sag_share: float = 0.0
    sag_s: float = 30.0


@dataclass(frozen=True, kw_only=True)
class PackingDefects:
    """Friction beyond a breakaway and a kinetic level.

    ``J_skew`` a makes the jump ``J (1 + a)`` when opening and ``J (1 - a)`` when closing at the
    same S; ``S_skew`` does that to S at the same J. ``bump_percent`` is added to both levels at
    ``bump_at_percent`` of travel and falls off like a Gaussian of ``bump_width_percent``
    (``exp(-1)`` there). After a rest of t seconds the breakaway level is higher by ``dwell_percent
    ln(1 + t/dwell_s)`` or, where it ``dwell_settles``, by ``dwell_percent (1 - exp(-t/dwell_s))``.
    A standing stem creeps by ``creep_percent_per_s``. ``presliding_percent`` is the elastic
    deflection before breakaway: above zero the friction is LuGre's with bristles that bend that
    far; at zero it is Karnopp's, without deflection. A LuGre packing breaks away a little below its
    breakaway level (0.002 %: slips 7 % smaller), and a deflection above 0.003 % rounds its slips
    off.
    """

    J_skew: float = 0.0
    S_skew: float = 0.0
    bump_percent: float = 0.0
    bump_at_percent: float = 50.0
    bump_width_percent: float = 5.0
    dwell_percent: float = 0.0
    dwell_s: float = 5.0
    dwell_settles: bool = False
    creep_percent_per_s: float = 0.0
    presliding_percent: float = 0.0


@dataclass(frozen=True, kw_only=True)
class BodyDefects:
    """Stops in the stroke, the fluid's force on the plug, inner friction of spring and diaphragm.

    The fluid lifts the plug by ``flow_percent`` more at both ends of the stroke than at
    ``flow_peak_percent`` of it. The spring resists each turn by up to ``hysteresis_percent``,
    reached exponentially over ``hysteresis_way_percent`` of travel.
    """

    low_percent: float = 0.0
    high_percent: float = 100.0
    flow_percent: float = 0.0
    flow_peak_percent: float = 50.0
    hysteresis_percent: float = 0.0
    hysteresis_way_percent: float = 3.0


@dataclass(frozen=True, kw_only=True)
class Upsets:
    """Changes over time: a factor on both friction levels, and forces on the stem.

    Friction: ``growth`` is the linear growth of the levels over the record, as a share; a slow wave
    of share ``wave`` and period ``wave_s``; episodes of a factor ``binding`` that come every
    ``binding_every_s`` on average and last ``binding_lasts_s``. Forces: a vibration of amplitude
    ``vibration_percent`` at ``vibration_hz``; first-order noise of standard deviation
    ``rough_percent`` and correlation time ``rough_s``; pushes by hand of ``push_percent``, every
    ``push_every_s`` on average, that last ``push_lasts_s``.
    """

    growth: float = 0.0
    wave: float = 0.0
    wave_s: float = 1800.0
    binding: float = 1.0
    binding_every_s: float = 600.0
    binding_lasts_s: float = 60.0
    vibration_percent: float = 0.0
    vibration_hz: float = 0.1
    rough_percent: float = 0.0
    rough_s: float = 20.0
    push_percent: float = 0.0
    push_every_s: float = 600.0
    push_lasts_s: float = 20.0
