"""``demo_plant``: fifteen valves of an invented refinery, one for each thing worth showing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator.defects import AirLine
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
from stemwatch.models.studies.simulator.parts import (
    LETTER,
    PV_RANGE,
    coloured_load,
    some_actuator,
    some_controller,
    some_process,
    some_setpoints,
    some_transmitters,
)
from stemwatch.models.studies.simulator.valve import SimulatedValve

DEMO_DURATION_S = 7200.0
Change = Callable[[PlantLoop, np.random.Generator], PlantLoop]


@dataclass(frozen=True, kw_only=True)
class _Entry:
    """One line of the plant list. ``S`` and ``J`` as read, percent."""

    kind: ProcessKind
    description: str
    area: str
    criticality: int
    story: str
    S: float = 0.3
    J: float = 0.0
    positioner_gain: float = 0.0
    load: tuple[float, float] = (0.2, 0.6)
    margin: float | None = None
    change: Change | None = None


def demo_plant(seed: int) -> list[PlantLoop]:
    """The fifteen loops, two hours at 1 s each; ``seed`` draws nameplates and settings.

    Healthy (three, one of them with bad data), the four shapes of stiction, badly tuned,
    oscillating disturbance, too few movements, frozen position transmitter, compressed archive,
    manual mode, a sticking valve without position transmitter, and one whose hidden physics S and J
    alone take for a sticking stem: it vents slowly and its command comes late.
    """
    return [
        _loop(entry, 101 + place, np.random.default_rng([seed, place, 2]))
        for place, entry in enumerate(_PLANT)
    ]


def _loop(entry: _Entry, number: int, rng: np.random.Generator) -> PlantLoop:
    air_lag_s = (1.0, 3.0) if entry.positioner_gain > 3.0 else (0.3, 0.8)
    actuator = some_actuator(rng, air_lag_s, 0.3)
    valve = SimulatedValve.showing(
        entry.S, entry.J, positioner_gain=entry.positioner_gain, actuator=actuator
    )
    process = some_process(entry.kind, rng)
    controller = some_controller(process, valve, rng, entry.margin)
    loop = PlantLoop(
        tag=f"{LETTER[entry.kind]}-{number}",
        description=entry.description,
        area=entry.area,
        criticality=entry.criticality,
        story=entry.story,
        valve=valve,
        process=process,
        controller=controller,
        transmitters=some_transmitters(controller.gain, rng, pv_noise=0.05, position_noise=0.05),
        pv_range=PV_RANGE[entry.kind],
        loads=coloured_load(process, rng, entry.load),
        duration_s=DEMO_DURATION_S,
    )
    return entry.change(loop, rng) if entry.change is not None else loop


def _set_points(loop: PlantLoop, rng: np.random.Generator) -> PlantLoop:
    steps = some_setpoints(
        loop.process, loop.controller, rng, duration_s=loop.duration_s, travel=(3.0, 12.0)
    )
    return replace(loop, setpoints=steps)


def _between_rests(loop: PlantLoop, _: np.random.Generator) -> PlantLoop:
    """One early step that starts the limit cycle: a level's carries OP across the dead band, any
    other's ends where no rest of the stuck stem can hold it."""
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
    """A restricted exhaust and a command that comes late, in a loop that is moved."""
    actuator = replace(loop.valve.actuator, air_lag_s=0.15, dead_time_s=2.5)
    valve = replace(loop.valve, actuator=actuator, air_line=AirLine(vent_percent_per_s=0.5))
    return _set_points(replace(loop, valve=valve), rng)


def _manual(loop: PlantLoop, _: np.random.Generator) -> PlantLoop:
    """In manual all the time: an operator moves the valve three times in two hours."""
    at = loop.controller.output
    knots = ((0.0, at), (1500.0, at), (1502.0, at + 4.0), (3900.0, at + 4.0), (3902.0, at + 1.0))
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
        Span(start_s=float(start), stop_s=float(start + length), role=roles[place % 3])
        for place, (start, length) in enumerate(zip(starts, lengths, strict=True))
    )
    gaps = (Span(start_s=2000.0, stop_s=2180.0), Span(start_s=5100.0, stop_s=5112.0))
    return replace(_set_points(loop, rng), archive=SimulatedArchive(bad=bad, gaps=gaps))


_FLOW, _LEVEL = ProcessKind.FLOW, ProcessKind.LEVEL
_PRESSURE, _TEMPERATURE = ProcessKind.PRESSURE, ProcessKind.TEMPERATURE
_PLANT = (
    _Entry(
        kind=_FLOW,
        description="Naphtha feed to the reactor",
        area="Reforming",
        criticality=3,
        story="healthy, smart positioner",
        positioner_gain=10.0,
        change=_set_points,
    ),
    _Entry(
        kind=_TEMPERATURE,
        description="Fuel gas to the charge heater",
        area="Reforming",
        criticality=3,
        story="healthy, no positioner",
        S=0.5,
        J=0.1,
        change=_set_points,
    ),
    _Entry(
        kind=_LEVEL,
        description="Product separator bottoms to the stabiliser",
        area="Reforming",
        criticality=2,
        story="sticky, deadband",
        S=6.0,
        change=_between_rests,
    ),
    _Entry(
        kind=_FLOW,
        description="Recycle gas to the charge heater",
        area="Reforming",
        criticality=3,
        story="sticky, undershoot",
        S=5.0,
        J=2.5,
        change=_between_rests,
    ),
    _Entry(
        kind=_PRESSURE,
        description="Stabiliser overhead to fuel gas",
        area="Reforming",
        criticality=2,
        story="sticky, no offset",
        S=4.0,
        J=4.0,
        change=_between_rests,
    ),
    _Entry(
        kind=_FLOW,
        description="Reflux to the atmospheric column",
        area="Crude distillation",
        criticality=3,
        story="sticky, overshoot",
        S=3.0,
        J=3.8,
        positioner_gain=1.5,
        change=_between_rests,
    ),
    _Entry(
        kind=_FLOW,
        description="Stripping steam to the side strippers",
        area="Crude distillation",
        criticality=2,
        story="healthy, badly tuned",
        margin=1.06,
        load=(0.8, 1.2),
    ),
    _Entry(
        kind=_PRESSURE,
        description="Desalter back pressure",
        area="Crude distillation",
        criticality=2,
        story="healthy, oscillating disturbance",
        change=_wave,
    ),
    _Entry(
        kind=_TEMPERATURE,
        description="Cooling water to the kerosene cooler",
        area="Crude distillation",
        criticality=1,
        story="healthy, too few movements",
        load=(0.01, 0.02),
    ),
    _Entry(
        kind=_FLOW,
        description="Heavy gas oil rundown",
        area="Crude distillation",
        criticality=1,
        story="healthy, position transmitter frozen",
        change=_frozen,
    ),
    _Entry(
        kind=_FLOW,
        description="Boiler feed water to the waste heat boiler",
        area="Utilities",
        criticality=3,
        story="healthy, compressed archive",
        positioner_gain=8.0,
        change=_compressed,
    ),
    _Entry(
        kind=_PRESSURE,
        description="Low-pressure steam let-down",
        area="Utilities",
        criticality=1,
        story="healthy, manual mode",
        change=_manual,
    ),
    _Entry(
        kind=_FLOW,
        description="Demineralised water to the deaerator",
        area="Utilities",
        criticality=2,
        story="sticky, undershoot, no position transmitter",
        S=4.5,
        J=3.0,
        change=_no_position,
    ),
    _Entry(
        kind=_LEVEL,
        description="Condensate drum to the deaerator",
        area="Utilities",
        criticality=2,
        story="healthy, bad data",
        positioner_gain=9.0,
        change=_bad_data,
    ),
    _Entry(
        kind=_FLOW,
        description="Reflux to the vacuum column",
        area="Vacuum distillation",
        criticality=3,
        story="healthy, vents slowly",
        S=0.6,
        J=0.2,
        load=(0.3, 0.8),
        change=_slow_venting,
    ),
)
