"""``ValveChain``: the fitted valve as numbers with names and units, for an external simulator.

    OP --curve--> command --dead time--> lag --> ringing --> speed limit --> air supply --> force
       --stick-slip--> stem --play--> position

It is the fitted chain. Where effects were named, it is ``mismatch.stem_model.kernel`` behind the
terms that shape the command, with the stored numbers of that fit and the published S and J; else
``stickslip.kernel`` with S, J and the actuator of the quick fit, whose lag and speed limit are one
device. Every parameter has a neutral value, which switches its effect off.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stemwatch.models.health_indicators.response_figures import OF_FIT
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.open_question import SLOW, OpenQuestion
from stemwatch.models.mismatch.terms.bowed_linkage import TO_HEIGHT
from stemwatch.models.preparation.own_clock import seconds_of
from stemwatch.models.screening_result import Screening
from stemwatch.models.stickslip.stroke_curve import StrokeCurve

FREE = 1e6  # percent a second: no speed limit
NO_STOP = 1000.0  # percent of travel, beyond every stroke
DWELL_TIME = 5.0  # units of the own clock, in the formula of the breakaway's rise


@dataclass(frozen=True, kw_only=True)
class ChainParameter:
    """One number of the chain: ``neutral`` switches its effect off; a ``tunable`` one may be
    changed during a run without a jump of the chain's state.
    """

    name: str
    unit: str
    meaning: str
    neutral: float = 0.0
    low: float | None = None
    high: float | None = None
    tunable: bool = True


def _fixed(name: str, unit: str, meaning: str, neutral: float, low: float | None) -> ChainParameter:
    return ChainParameter(
        name=name, unit=unit, meaning=meaning, neutral=neutral, low=low, tunable=False
    )


def _tunable(
    name: str,
    unit: str,
    meaning: str,
    neutral: float = 0.0,
    low: float | None = 0.0,
    high: float | None = None,
) -> ChainParameter:
    return ChainParameter(
        name=name, unit=unit, meaning=meaning, neutral=neutral, low=low, high=high
    )


# The order of the parameters in every simulator.
CHAIN_PARAMETERS = (
    _fixed(
        "sample_time",
        "s",
        "The valve moves once in this time: the interval of the record that was fitted; a shorter "
        "one is allowed",
        1.0,
        1e-6,
    ),
    _fixed(
        "position_start", "%", "Position at the beginning, as near as friction lets it", 50, None
    ),
    _fixed(
        "travel_per_op",
        "1",
        "Percent of travel for a percent of OP, by which S and J count",
        1.0,
        None,
    ),
    _fixed("dead_time", "s", "The command arrives so much later", 0.0, 0.0),
    _tunable("S", "%", "Dead band plus stick band, percent of OP"),
    _tunable("J", "%", "Slip jump, percent of OP"),
    _tunable("lag_rising", "s", "Time constant of the actuator while its command is higher"),
    _tunable("lag_falling", "s", "Time constant of the actuator while its command is lower"),
    _tunable(
        "speed_rising", "%/s", f"Top speed rising, percent of travel; {FREE:g} is none", FREE, 1e-9
    ),
    _tunable(
        "speed_falling",
        "%/s",
        f"Top speed falling, percent of travel; {FREE:g} is none",
        FREE,
        1e-9,
    ),
    _tunable("ring_frequency", "rad/s", "Natural frequency of a ringing positioner; 0 is none"),
    _tunable("ring_damping", "1", "Damping ratio of a ringing positioner", 1.0),
    _tunable(
        "supply_sag",
        "%",
        "Percent of a move that the air supply lacks; negative: falling uses the air",
        0.0,
        -100.0,
        100.0,
    ),
    _tunable(
        "supply_recovery", "s", "Time constant with which the air supply recovers", 60.0, 1e-6
    ),
    _tunable(
        "slip_asymmetry",
        "1",
        "Share by which jumps rising are larger than J, and falling smaller",
        0.0,
        -1.0,
        1.0,
    ),
    _tunable("drag", "s", "Time constant with which the stem slides to its place"),
    _tunable(
        "restick_speed",
        "%/s",
        "A moving stem sticks again below this speed; negative: only where its command turns",
        0.0,
        None,
    ),
    _tunable("run_up", "s", "Time in which a drive with inertia runs up; 0 is none"),
    _tunable(
        "top_speed",
        "%/s",
        f"Speed at full voltage of a drive with inertia; {FREE:g} is no limit",
        FREE,
        1e-9,
    ),
    _tunable("creep", "%/s", "Speed of a stem at rest, negative: falling", 0.0, None),
    _tunable("gives", "1", "Percent of travel that a stem at rest gives for a percent of force"),
    _tunable("stop_low", "%", "The stem goes no lower", -NO_STOP, None),
    _tunable("stop_high", "%", "The stem goes no higher", NO_STOP, None),
    _tunable("tight_friction", "%", "Friction in one band of travel, percent of travel"),
    _tunable("tight_place", "%", "Middle of the band of travel with more friction", 50.0, None),
    _tunable("tight_width", "%", "Width of the band of travel with more friction", 5.0, 1e-6),
    _tunable(
        "flow_force",
        "%",
        "Force of the flow in the middle of travel against its ends, positive pushes down",
        0.0,
        None,
    ),
    _tunable("load_linear", "%", "Load over travel, coefficient of z = (x - 50)/50", 0.0, None),
    _tunable("load_square", "%", "Load over travel, coefficient of z squared", 0.0, None),
    _tunable("load_cube", "%", "Load over travel, coefficient of z cubed", 0.0, None),
    _tunable("spring_hysteresis", "%", "What the spring holds back of a turn, to either side"),
    _tunable("spring_way", "%", "Travel over which its inner friction turns", 6.0, 1e-6),
    _tunable(
        "dwell_breakaway", "%", "Rise of the breakaway each time the rest is 2.7 times longer"
    ),
    _tunable("dwell_time", "s", "Rest from which the rise of the breakaway counts", 5.0, 1e-6),
    _tunable("play", "%", "Play between stem and position sensor"),
    _tunable("reading_zero", "%", "What the position reads too high at 50 % of travel", 0.0, None),
    _tunable("reading_gain", "1", "Percent of reading for a percent of travel", 1.0, None),
    _fixed(
        "record_time",
        "s",
        "Length of the recording that was fitted. Friction grows and the reading drifts over so "
        "long from the start of the simulation, and stay as they then are",
        3600.0,
        1e-6,
    ),
    _tunable("friction_growth", "1", "Share by which S and J grow over record_time", 0.0, -1.0),
    _tunable("reading_drift", "%", "Straight drift of the reading over record_time", 0.0, None),
    *(
        _tunable(
            f"reading_wave_{j}",
            "%",
            f"Slow wave of the reading, {j} half periods in record_time",
            0.0,
            None,
        )
        for j in (1, 2, 3)
    ),
)
_NAMES = frozenset(parameter.name for parameter in CHAIN_PARAMETERS)
# The coordinates of each term of the catalogue, as parameters of the chain, with the unit by which
# their time is converted; see ``coordinates`` of the term.
_OF_TERM: Mapping[str, tuple[tuple[str, str], ...]] = {
    "dead_time": (("dead_time", "s"),),
    "actuator_lag": (("lag", "s"),),
    "asymmetric_lag": (("lag_rising", "s"), ("lag_falling", "s")),
    "underdamped_positioner": (("ring_frequency", "rad/s"), ("ring_damping", "")),
    "rate_limit": (("slowness", "s"),),
    "asymmetric_rate_limit": (("slowness_rising", "s"), ("slowness_falling", "s")),
    "supply_sag": (("supply_share", ""), ("supply_recovery", "s")),
    "asymmetric_slip": (("slip_asymmetry", ""),),
    "viscous_drag": (("drag", "s"),),
    "low_speed_restick": (("restick_speed", "%/s"),),
    "slip_overshoot": (("restick_speed", "%/s"),),
    "motor_drive": (("drag", "s"), ("run_up", "s"), ("slowness_of_drive", "s")),
    "stem_creep": (("creep", "%/s"),),
    "presliding": (("gives", ""),),
    "travel_stop": (("inside_low", "%"), ("inside_high", "%")),
    "position_dependent_friction": (
        ("tight_friction", "%"),
        ("tight_place", "%"),
        ("tight_width", "%"),
    ),
    "flow_force": (("flow_force", "%"),),
    "load_by_position": (("load_linear", "%"), ("load_square", "%"), ("load_cube", "%")),
    "bowed_linkage": (("bow", "%"),),
    "spring_hysteresis": (("spring_hysteresis", "%"), ("spring_way", "%")),
    "dwell_dependent_breakaway": (("dwell_breakaway", "%"),),
    "lost_motion": (("play", "%"),),
    "growing_stiction": (("friction_growth", ""),),
    "sensor_drift": (
        ("reading_drift", "%"),
        ("reading_wave_1", "%"),
        ("reading_wave_2", "%"),
        ("reading_wave_3", "%"),
    ),
}


@dataclass(frozen=True, kw_only=True)
class ValveChain:
    """The fitted valve: the value of each of ``CHAIN_PARAMETERS`` by name.

    ``curve`` from OP to stroke, ``None`` where OP is percent of travel; ``op_start`` where OP was
    at the end of the recording, percent. ``one_actuator``: lag and speed limit are one device, and
    the stem slides while its command moves, as in ``stickslip.kernel``. ``unit_s`` seconds in a
    unit of the clock on which the valve was fitted. ``named`` are the effects in it.
    """

    valve: str
    values: Mapping[str, float]
    curve: StrokeCurve | None = None
    op_start: float = 50.0
    one_actuator: bool = True
    unit_s: float = 1.0
    named: tuple[str, ...] = ()


def valve_chain(screening: Screening) -> ValveChain | str:
    """The chain of a screened valve; or, in one sentence, why there is none."""
    S, J, mismatch = screening.S, screening.J, screening.mismatch
    if S.value is None:
        return f"S is not known: {S.reason}"
    question = None if mismatch is None else mismatch.open_question
    seen = screening.seen
    if question is None and seen is None:
        return "the interval of its recording was not kept; screen it again"
    curve = screening.stroke_curve
    own = {parameter.name: parameter.neutral for parameter in CHAIN_PARAMETERS}
    own |= {"S": S.value, "J": J.value or 0.0}
    own["travel_per_op"] = 1.0 if curve is None else curve.slope
    unit_s = 1.0 if question is None else question.unit_s
    if question is not None:
        own["sample_time"] = question.interval * unit_s
    elif seen is not None:
        own["sample_time"] = seen.interval_s
    own["dwell_time"] = DWELL_TIME * unit_s
    op_start = 50.0 if question is None or question.op is None else question.op
    begins = op_start if curve is None else float(curve.command(np.array([op_start]))[0])
    effects = () if mismatch is None else tuple(effect.slug for effect in mismatch.effects)
    if not effects or question is None:
        own |= _of_quick_fit(screening)
        own["restick_speed"] = 0.0 if question is None else _restick(question.restick, unit_s)
    elif question.published is None or (question.duration <= 0.0 and SLOW & {*effects}):
        return (
            f"{' and '.join(slug.replace('_', ' ') for slug in effects)} was named by a version "
            "that did not keep the fitted model; screen it again"
        )
    elif lacking := question.published.terms.keys() - _OF_TERM.keys():
        names = " and ".join(sorted(slug.replace("_", " ") for slug in lacking))
        return f"models for other simulators do not have {names}, which was named"
    else:
        own |= _of_published(question)
        own["record_time"] = question.duration * unit_s or own["record_time"]
    zero = own["reading_zero"] - 0.5 * own["reading_drift"]
    own["position_start"] = own["reading_gain"] * (begins - 50.0) + 50.0 + zero
    assert own.keys() == _NAMES
    return ValveChain(
        valve=screening.valve,
        values=own,
        curve=curve,
        op_start=op_start,
        one_actuator=not effects,
        unit_s=unit_s,
        named=effects,
    )


_OF_QUICK_FIT = {
    "theta": "dead_time",
    "tau_rising": "lag_rising",
    "tau_falling": "lag_falling",
    "rate_rising": "speed_rising",
    "rate_falling": "speed_falling",
}


def _of_quick_fit(screening: Screening) -> dict[str, float]:
    """Actuator and zero of the reading, by the indicators."""
    known = {name: indicator.value for name, indicator in screening.indicators.items()}
    own = {_OF_QUICK_FIT[OF_FIT[name]]: known[name] for name in OF_FIT if name in known}
    return own | {"reading_zero": known.get("position_zero_percent", 0.0)}


def _restick(speed: float, unit_s: float) -> float:
    """The speed of sticking again for a simulator. A stem that sticks at every sample has an
    infinite speed, which most file formats cannot hold.
    """
    return min(seconds_of(speed, "%/s", unit_s), FREE)


def _of_published(question: OpenQuestion) -> dict[str, float]:
    """The stored numbers of the fit with the named effects; S and J are the published ones."""
    assert question.published is not None
    unit_s = question.unit_s
    base = np.array(question.published.base).mean(axis=0)
    restick = float(base[base_coordinate.RESTICK])
    restick = restick if restick > 0.0 else question.restick
    values = {
        "dead_time": seconds_of(float(base[base_coordinate.DELAY]), "s", unit_s),
        "restick_speed": _restick(restick, unit_s),
        "reading_zero": float(base[base_coordinate.ZERO]),
        "reading_gain": 1.0 + float(base[base_coordinate.GAIN]),
    }
    delay = values["dead_time"]
    for slug, halves in question.published.terms.items():
        for (name, unit), value in zip(
            _OF_TERM[slug], np.array(halves).mean(axis=0).tolist(), strict=True
        ):
            true = seconds_of(value, unit, unit_s)
            if name != "restick_speed" or true > 0.0:
                values |= _named(name, true, delay)
    return values


def _named(name: str, value: float, delay: float) -> dict[str, float]:
    """The parameters of the chain that a coordinate of a term gives."""
    speed = min(1.0 / value, FREE) if value > 0.0 else FREE
    return {
        "dead_time": {"dead_time": delay + value},
        "lag": {"lag_rising": value, "lag_falling": value},
        "slowness": {"speed_rising": speed, "speed_falling": speed},
        "slowness_rising": {"speed_rising": speed},
        "slowness_falling": {"speed_falling": speed},
        "slowness_of_drive": {"top_speed": speed},
        # A reading that is bent is the same as a force of that shape.
        "bow": {"load_linear": -TO_HEIGHT * value, "load_cube": TO_HEIGHT * value},
        "supply_share": {"supply_sag": 100.0 * value},
        "inside_low": {"stop_low": value if value > 0.0 else -NO_STOP},
        "inside_high": {"stop_high": 100.0 - value if value > 0.0 else NO_STOP},
    }.get(name, {name: value})
