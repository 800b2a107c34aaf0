"""``demo_plant``: fifteen valves of an invented refinery, one for each finding to demonstrate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator.defects import AirLine
from stemwatch.models.studies.simulator.draw_parts import (
    LETTER,
    PV_RANGE,
    coloured_load,
    draw_actuator,
    draw_controller,
    draw_process,
    draw_setpoints,
    draw_transmitters,
)
from stemwatch.models.studies.simulator.loop import (
    Compression,
    CompressionKind,
    Load,
    LoadKind,
    ManualSpan,
    PlantLoop,
    ProcessKind,
    SimulatedArchive,
    Span,
)
from stemwatch.models.studies.simulator.valve import SimulatedValve

DEMO_DURATION_S = 7200.0
WEEKS_BEFORE = 5
Change = Callable[[PlantLoop, np.random.Generator], PlantLoop]


class _Nameplate(NamedTuple):
    """One line of the plant list."""

    kind: ProcessKind
    area: str
    unit: str
    criticality: int
    description: str


class _Story(NamedTuple):
    """What a loop demonstrates; ``S`` and ``J`` as read off the OP-MV loop, percent."""

    text: str
    change: Change | None = None
    S: float = 0.3
    J: float = 0.0
    positioner_gain: float = 0.0
    load: tuple[float, float] = (0.2, 0.6)
    margin: float | None = None


def demo_plant(seed: int) -> list[PlantLoop]:
    """The fifteen loops, two hours at 1 s each; ``seed`` draws nameplates and settings.

    Healthy (three, one of them with bad data), the four shapes of stiction, badly tuned,
    oscillating disturbance, too few movements, frozen position transmitter, compressed archive,
    manual mode, a sticking valve without position transmitter, and one that vents slowly and whose
    command comes late, which looks like a sticking stem to a fit of S and J alone.
    """
    return [
        _loop(nameplate, story, 101 + index, np.random.default_rng([seed, index, 2]))
        for index, (nameplate, story) in enumerate(zip(_PLANT, _STORIES, strict=True))
    ]


def _loop(nameplate: _Nameplate, story: _Story, number: int, rng: np.random.Generator) -> PlantLoop:
    air_lag_s = (1.0, 3.0) if story.positioner_gain > 3.0 else (0.3, 0.8)
    actuator = draw_actuator(rng, air_lag_s, 0.3)
    valve = SimulatedValve.showing(
        story.S, story.J, positioner_gain=story.positioner_gain, actuator=actuator
    )
    process = draw_process(nameplate.kind, rng)
    controller = draw_controller(process, valve, rng, story.margin)
    loop = PlantLoop(
        tag=f"{LETTER[nameplate.kind]}-{number}",
        description=nameplate.description,
        area=nameplate.area,
        unit=nameplate.unit,
        price_per_unit_hour=_PRICES[nameplate.kind],
        criticality=nameplate.criticality,
        story=story.text,
        valve=valve,
        process=process,
        controller=controller,
        transmitters=draw_transmitters(controller.gain, rng, pv_noise=0.05, position_noise=0.05),
        pv_range=PV_RANGE[nameplate.kind],
        loads=coloured_load(process, rng, story.load),
        duration_s=DEMO_DURATION_S,
    )
    return story.change(loop, rng) if story.change is not None else loop


def weeks_before(seed: int) -> list[tuple[float, PlantLoop]]:
    """One valve of the plant in the weeks before, 40 minutes each, while its friction grew: the
    weeks, and the loop as it was. S rises to what ``demo_plant`` has."""
    index = next(k for k, story in enumerate(_STORIES) if story.text == "sticky, undershoot")
    nameplate, story = _PLANT[index], _STORIES[index]
    earlier = []
    for weeks in range(WEEKS_BEFORE, 0, -1):
        share = 1.0 - 0.6 * weeks / WEEKS_BEFORE
        worn = story._replace(S=share * story.S, J=share * story.J)
        rng = np.random.default_rng([seed, index, 2])
        loop = _loop(nameplate, worn, 101 + index, rng)
        earlier.append((float(weeks), replace(loop, duration_s=DEMO_DURATION_S / 3.0)))
    return earlier


def _set_points(loop: PlantLoop, rng: np.random.Generator) -> PlantLoop:
    steps = draw_setpoints(
        loop.process, loop.controller, rng, duration_s=loop.duration_s, travel=(3.0, 12.0)
    )
    return replace(loop, setpoints=steps)


def _between_rests(loop: PlantLoop, _: np.random.Generator) -> PlantLoop:
    """One early set-point step that starts the limit cycle. On a level it moves OP across the dead
    band; on other loops it ends at a value that no position of the stuck stem can hold.
    """
    step = 0.45 * max(loop.valve.J_read, 1.0) * loop.process.gain
    if loop.process.integrating:
        step = 1.5 * loop.valve.S_read / loop.controller.gain
    return replace(loop, setpoints=((10.0, loop.controller.set_point + step),))


def _wave(loop: PlantLoop, _: np.random.Generator) -> PlantLoop:
    wave = Load(kind=LoadKind.OSCILLATING, size=5.0, time_s=95.0, drift_rad=0.25)
    return replace(loop, loads=(wave, *loop.loads))


def _frozen(loop: PlantLoop, rng: np.random.Generator) -> PlantLoop:
    frozen = (Span(start_s=1300.0, stop_s=loop.duration_s, role=Role.MV),)
    return replace(_set_points(loop, rng), archive=SimulatedArchive(frozen=frozen))


def _compressed(loop: PlantLoop, rng: np.random.Generator) -> PlantLoop:
    door = CompressionKind.SWINGING_DOOR
    columns = tuple(
        Compression(role=role, kind=door, deviation=0.5) for role in (Role.OP, Role.MV, Role.PV)
    )
    return replace(_set_points(loop, rng), archive=SimulatedArchive(compression=columns))


def _slow_venting(loop: PlantLoop, rng: np.random.Generator) -> PlantLoop:
    """A restricted exhaust and a late command, in a loop with set-point moves."""
    actuator = replace(loop.valve.actuator, air_lag_s=0.15, dead_time_s=2.5)
    valve = replace(loop.valve, actuator=actuator, air_line=AirLine(vent_percent_per_s=0.5))
    return _set_points(replace(loop, valve=valve), rng)


def _manual(loop: PlantLoop, _: np.random.Generator) -> PlantLoop:
    """In manual all the time: an operator moves the valve three times in two hours."""
    opening = loop.controller.output
    knots = (
        (0.0, opening),
        (1500.0, opening),
        (1502.0, opening + 4.0),
        (3900.0, opening + 4.0),
        (3902.0, opening + 1.0),
    )
    span = ManualSpan(start_s=-loop.warmup_s, stop_s=loop.duration_s, knots=knots)
    return replace(loop, manual=(span,))


def _no_position(loop: PlantLoop, rng: np.random.Generator) -> PlantLoop:
    blind = replace(loop.transmitters, has_position=False)
    return replace(_between_rests(loop, rng), transmitters=blind)


def _bad_data(loop: PlantLoop, rng: np.random.Generator) -> PlantLoop:
    """Short and long stretches of bad status, and gaps of the whole archive."""
    starts = np.sort(rng.uniform(300.0, 6600.0, 9))
    lengths = rng.choice([4.0, 20.0, 75.0, 240.0], 9)
    roles = (Role.MV, Role.PV, Role.OP)
    bad = tuple(
        Span(start_s=float(start), stop_s=float(start + length), role=roles[index % 3])
        for index, (start, length) in enumerate(zip(starts, lengths, strict=True))
    )
    gaps = (Span(start_s=2000.0, stop_s=2180.0), Span(start_s=5100.0, stop_s=5112.0))
    return replace(_set_points(loop, rng), archive=SimulatedArchive(bad=bad, gaps=gaps))


_FLOW, _LEVEL = ProcessKind.FLOW, ProcessKind.LEVEL
_PRESSURE, _TEMPERATURE = ProcessKind.PRESSURE, ProcessKind.TEMPERATURE
# Invented: money for an hour with PV one unit away from its set point.
_PRICES = {_FLOW: 9.0, _LEVEL: 0.4, _PRESSURE: 40.0, _TEMPERATURE: 1.5}
_PLANT = (
    _Nameplate(_FLOW, "Reforming", "300", 3, "Naphtha feed to the reactor"),
    _Nameplate(_TEMPERATURE, "Reforming", "300", 3, "Fuel gas to the charge heater"),
    _Nameplate(_LEVEL, "Reforming", "300", 2, "Product separator bottoms to the stabiliser"),
    _Nameplate(_FLOW, "Reforming", "300", 3, "Recycle gas to the charge heater"),
    _Nameplate(_PRESSURE, "Reforming", "300", 2, "Stabiliser overhead to fuel gas"),
    _Nameplate(_FLOW, "Crude distillation", "100", 3, "Reflux to the atmospheric column"),
    _Nameplate(_FLOW, "Crude distillation", "100", 2, "Stripping steam to the side strippers"),
    _Nameplate(_PRESSURE, "Crude distillation", "100", 2, "Desalter back pressure"),
    _Nameplate(
        _TEMPERATURE, "Crude distillation", "100", 1, "Cooling water to the kerosene cooler"
    ),
    _Nameplate(_FLOW, "Crude distillation", "100", 1, "Heavy gas oil rundown"),
    _Nameplate(_FLOW, "Utilities", "900", 3, "Boiler feed water to the waste heat boiler"),
    _Nameplate(_PRESSURE, "Utilities", "900", 1, "Low-pressure steam let-down"),
    _Nameplate(_FLOW, "Utilities", "900", 2, "Demineralised water to the deaerator"),
    _Nameplate(_LEVEL, "Utilities", "900", 2, "Condensate drum to the deaerator"),
    _Nameplate(_FLOW, "Vacuum distillation", "200", 3, "Reflux to the vacuum column"),
)
# What each of them demonstrates, in the same order.
_STORIES = (
    _Story("healthy, smart positioner", _set_points, positioner_gain=10.0),
    _Story("healthy, no positioner", _set_points, S=0.5, J=0.1),
    _Story("sticky, deadband", _between_rests, S=6.0),
    _Story("sticky, undershoot", _between_rests, S=5.0, J=2.5),
    _Story("sticky, no offset", _between_rests, S=4.0, J=4.0),
    _Story("sticky, overshoot", _between_rests, S=3.0, J=3.8, positioner_gain=1.5),
    _Story("healthy, badly tuned", load=(0.8, 1.2), margin=1.06),
    _Story("healthy, oscillating disturbance", _wave),
    _Story("healthy, too few movements", load=(0.01, 0.02)),
    _Story("healthy, position transmitter frozen", _frozen),
    _Story("healthy, compressed archive", _compressed, positioner_gain=8.0),
    _Story("healthy, manual mode", _manual),
    _Story("sticky, undershoot, no position transmitter", _no_position, S=4.5, J=3.0),
    _Story("healthy, bad data", _bad_data, positioner_gain=9.0),
    _Story("healthy, vents slowly", _slow_venting, S=0.6, J=0.2, load=(0.3, 0.8)),
)
