"""Months of a simulated valve: wear, defects and repairs, and the loop on each day."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

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
    Load,
    ManualSpan,
    PlantLoop,
    ProcessKind,
    SimulatedArchive,
    Span,
)
from stemwatch.models.studies.simulator.valve import SimulatedValve

CROSSES_PERCENT = 1.5  # the limit of a sticky valve, of S
IS_A_CAUSE_PERCENT = 0.75  # from this S on an alert is justified: the watch limit
WORN_S_PERCENT = (2.5, 5.0)
_FIRST_WEAR, _LAST_WEAR = 0.1, 0.3  # when wear begins, as a share of the simulated time
_WEARS_OVER = 0.4
_REPAIRED_AFTER = 10  # days after S crossed its limit
_HELPLESS_AFTER = 6
_STEPS = 4
_SEASON_DAYS = 60.0
_VENTS_PERCENT_PER_S = 0.6
_ZERO = 0.3  # percent of travel


class Life(StrEnum):
    """What happens to a valve over the months."""

    STEADY = "healthy, set points and loads of every day"
    CAMPAIGNS = "healthy, product campaigns"
    SEASONS = "healthy, loads by the season"
    RETUNED = "healthy, controller tuned anew"
    TRANSMITTER = "healthy, position transmitter replaced"
    SHUTDOWNS = "healthy, shutdowns"
    BAD_DATA = "healthy, bad data"
    WEARS = "wears steadily"
    STEPS = "wears in steps"
    NOT_HELPED = "wears, and the work did not help"
    REPAIRED = "wears, repaired and recorded"
    UNRECORDED = "wears, repaired and not recorded"
    VENTS = "begins to vent slowly"


HEALTHY = tuple(life for life in Life if life.value.startswith("healthy"))
# Of thirteen valves eight are healthy all the time.
IN_TURN = (
    Life.STEADY, Life.WEARS, Life.CAMPAIGNS, Life.SEASONS, Life.STEPS, Life.RETUNED,
    Life.REPAIRED, Life.TRANSMITTER, Life.SHUTDOWNS, Life.NOT_HELPED, Life.BAD_DATA,
    Life.UNRECORDED, Life.STEADY, Life.VENTS, Life.CAMPAIGNS, Life.SEASONS,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ValveLife:
    """One valve over ``days`` days. ``loop`` is the healthy one of the first day; ``begins`` is the
    first day of wear or defect, ``worn`` S (percent of span) at its end, ``repaired`` the day on
    which it is healthy again and ``worked`` the days of recorded work; ``None`` and empty where
    there are none.
    """

    tag: str
    life: Life
    days: int
    loop: PlantLoop
    seed: int
    begins: int | None = None
    worn: float = 0.0
    repaired: int | None = None
    worked: tuple[int, ...] = ()

    def S(self, day: int) -> float:
        """S of the valve on ``day`` (from 0), percent of span."""
        well = self.loop.valve.S_read
        if self.begins is None or self.life is Life.VENTS or day < self.begins:
            return well
        if self.repaired is not None and day >= self.repaired:
            return well
        share = min((day - self.begins) / max(_WEARS_OVER * self.days, 1.0), 1.0)
        if self.life is Life.STEPS:
            share = np.ceil(share * _STEPS) / _STEPS
        return float(well + share * (self.worn - well))

    def has_cause(self, day: int) -> bool:
        """Whether an alert about the valve on ``day`` has a cause."""
        vents = self.life is Life.VENTS and self.begins is not None and day >= self.begins
        return vents or self.S(day) >= IS_A_CAUSE_PERCENT

    def will_have_cause(self, day: int) -> bool:
        """Whether it wears on ``day`` and will cross its limit, so that a forecast of it is
        right.
        """
        crosses = self.crosses
        begun = self.begins is not None and day >= self.begins
        return begun and crosses is not None and day <= crosses

    @property
    def crosses(self) -> int | None:
        """The first day on which it needs work; ``None`` where there is none."""
        if self.life is Life.VENTS:
            return self.begins
        return next((day for day in range(self.days) if self.S(day) >= CROSSES_PERCENT), None)

    def on(self, day: int, duration_s: float) -> PlantLoop:
        """The loop as it is recorded on ``day``, for ``duration_s`` seconds."""
        rng = np.random.default_rng([self.seed, day])
        loop = replace(self.loop, duration_s=duration_s, valve=self._valve(day))
        if self.life is Life.CAMPAIGNS:
            loop = _campaign(loop, np.random.default_rng([self.seed, 1, day // 12]))
        if self.life is Life.RETUNED and day >= self.days // 3:
            slower = replace(
                loop.controller,
                gain=0.6 * loop.controller.gain,
                reset_s=1.4 * loop.controller.reset_s,
            )
            loop = replace(loop, controller=slower)
        if self.life is Life.TRANSMITTER and day >= self.days // 3:
            other = np.random.default_rng([self.seed, 2])
            repacked = replace(
                loop.transmitters,
                position_zero=float(other.uniform(-_ZERO, _ZERO)),
                position_noise=float(other.uniform(0.02, 0.1)),
            )
            loop = replace(loop, transmitters=repacked)
        loop = replace(loop, loads=self._loads(loop, day, rng))
        loop = replace(loop, setpoints=_set_points(loop, rng))
        if self.life is Life.SHUTDOWNS and day % 30 in (10, 11, 12, 13):
            loop = _shut(loop)
        if self.life is Life.BAD_DATA:
            loop = replace(loop, archive=_bad(duration_s, rng))
        return loop

    def _valve(self, day: int) -> SimulatedValve:
        well = self.loop.valve
        if self.life is Life.VENTS:
            if self.begins is None or day < self.begins:
                return well
            return replace(well, air_line=AirLine(vent_percent_per_s=_VENTS_PERCENT_PER_S))
        S = self.S(day)
        if S <= well.S_read:
            return well
        return SimulatedValve.showing(S, 0.35 * S, scatter=well.scatter, actuator=well.actuator)

    def _loads(self, loop: PlantLoop, day: int, rng: np.random.Generator) -> tuple[Load, ...]:
        """Each day has loads of its own size; by the season they grow to three times and back."""
        size = float(rng.uniform(0.7, 1.4))
        if self.life is Life.SEASONS:
            size *= 2.0 - np.cos(2.0 * np.pi * day / _SEASON_DAYS)
        return tuple(replace(load, size=size * load.size) for load in loop.loads)


def draw_lives(n: int, days: int, seed: int) -> list[ValveLife]:
    """``n`` valves over ``days`` days, the lives of ``IN_TURN`` in turn. The first k do not depend
    on ``n``."""
    return [_life(index, days, np.random.default_rng([seed, index, 9])) for index in range(n)]


def _life(index: int, days: int, rng: np.random.Generator) -> ValveLife:
    life = IN_TURN[index % len(IN_TURN)]
    kinds = (ProcessKind.FLOW, ProcessKind.FLOW, ProcessKind.PRESSURE)
    kind = kinds[int(rng.integers(len(kinds)))]
    process = draw_process(kind, rng)
    S = float(rng.uniform(0.15, 0.45))
    actuator = draw_actuator(rng, (0.1, 0.5), 0.3)
    valve = SimulatedValve(S=S, J=0.25 * S, scatter=0.04, actuator=actuator)
    controller = draw_controller(process, valve, rng)
    # A healthy transmitter has zero and span errors below those that are named; larger ones are
    # defects.
    transmitters = replace(
        draw_transmitters(
            controller.gain,
            rng,
            pv_noise=float(rng.uniform(0.02, 0.1)),
            position_noise=float(rng.uniform(0.02, 0.08)),
        ),
        position_zero=float(rng.uniform(-_ZERO, _ZERO)),
        position_span=1.0,
    )
    loop = PlantLoop(
        tag=f"{LETTER[kind]}-{100 + index}",
        story=life.value,
        valve=valve,
        process=process,
        controller=controller,
        transmitters=transmitters,
        pv_range=PV_RANGE[kind],
        loads=coloured_load(process, rng, (0.4, 1.0)),
    )
    valve_life = ValveLife(
        tag=loop.tag, life=life, days=days, loop=loop, seed=int(rng.integers(2**31))
    )
    if life in HEALTHY:
        return valve_life
    begins = max(int(rng.uniform(_FIRST_WEAR, _LAST_WEAR) * days), 1)
    valve_life = replace(valve_life, begins=begins, worn=float(rng.uniform(*WORN_S_PERCENT)))
    crosses = valve_life.crosses
    if crosses is None:
        return valve_life
    if life is Life.NOT_HELPED:
        return replace(valve_life, worked=(crosses + _HELPLESS_AFTER,))
    if life in (Life.REPAIRED, Life.UNRECORDED):
        day = crosses + _REPAIRED_AFTER
        return replace(valve_life, repaired=day, worked=(day,) if life is Life.REPAIRED else ())
    return valve_life


def _set_points(loop: PlantLoop, rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    return draw_setpoints(
        loop.process, loop.controller, rng, duration_s=loop.duration_s, travel=(3.0, 12.0)
    )


def _campaign(loop: PlantLoop, rng: np.random.Generator) -> PlantLoop:
    """Another product: another opening, another set point."""
    opening = float(rng.uniform(30.0, 70.0))
    return replace(loop, controller=replace(loop.controller, output=opening))


def _shut(loop: PlantLoop) -> PlantLoop:
    """The loop in manual, with the valve almost closed."""
    span = ManualSpan(
        start_s=-loop.warmup_s,
        stop_s=loop.duration_s + 60.0,
        knots=((-loop.warmup_s, 2.0), (loop.duration_s + 60.0, 2.0)),
    )
    return replace(loop, manual=(span,), setpoints=())


def _bad(duration_s: float, rng: np.random.Generator) -> SimulatedArchive:
    """Bad status now and then, a gap, and on one day in eight a position that stands still."""
    starts = np.sort(rng.uniform(0.0, 0.9 * duration_s, 4))
    bad = tuple(
        Span(start_s=float(start), stop_s=float(start + rng.uniform(5.0, 60.0)), role=Role.MV)
        for start in starts
    )
    gap = Span(start_s=0.4 * duration_s, stop_s=0.4 * duration_s + float(rng.uniform(5.0, 90.0)))
    frozen = (
        (Span(start_s=0.3 * duration_s, stop_s=duration_s, role=Role.MV),)
        if rng.random() < 1 / 8
        else ()
    )
    return SimulatedArchive(bad=bad, gaps=(gap,), frozen=frozen)
