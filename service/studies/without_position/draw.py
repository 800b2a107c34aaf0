"""Simulated loops of several families, whose position, where there is one, is left out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.studies.loops.draws import DrawnLoop, draw_loop
from stemwatch.models.studies.simulator.draws import draw_healthy, draw_sticky
from stemwatch.models.studies.simulator.simulate import simulate_loop
from stemwatch.models.without_position.features import Evidence
from stemwatch.models.without_position.network import LoopScore
from stemwatch.models.without_position.suspicion import (
    LEAST_S_PERCENT,
    SeenLoop,
    estimated_S,
    look_at_loop,
    predicts_better,
    sticking_score,
)


@dataclass(frozen=True)
class LoopToDraw:
    """One loop to draw: seed, place, and the family it is of."""

    seed: int
    place: int
    family: str = "own"


@dataclass(frozen=True, kw_only=True)
class SeenDraw:
    """A simulated loop as it is seen, and its truth."""

    place: LoopToDraw
    story: str
    S: float
    seen: SeenLoop


def look_item(item: LoopToDraw) -> list[SeenDraw]:
    """Draw one loop, leave out what it has of a position, and look."""
    recording, S, story = FAMILIES[item.family](item)
    return [SeenDraw(place=item, story=story, S=S, seen=look_at_loop(recording))]


def _own_loop(item: LoopToDraw, story: str = "") -> tuple[Recording, float, str]:
    loop = draw_loop(item.seed, item.place, story)
    return recording_of(loop, f"LOOP-{item.place}"), loop.S, loop.story


def _wave(item: LoopToDraw) -> tuple[Recording, float, str]:
    return _own_loop(item, "wave")


def _plant(item: LoopToDraw) -> tuple[Recording, float, str]:
    """The force-balance plant of ``stemwatch trial``, without its position."""
    sticks = item.place % 2 == 0
    loop = (draw_sticky if sticks else draw_healthy)(item.place // 2 + 1, item.seed)[-1]
    recording = simulate_loop(loop, item.seed * 1_000 + item.place).recording
    signals = dict(recording.signals)
    del signals[Role.MV]
    S = loop.valve.S_read if sticks else 0.0
    return replace(recording, signals=signals), S, loop.story


def recording_of(loop: DrawnLoop, valve: str) -> Recording:
    """A simulated loop as a recording of OP, PV and SP."""
    return Recording(
        valve=valve,
        signals={
            Role.OP: Signal.good(loop.op, "OP"),
            Role.PV: Signal.good(loop.pv, "PV"),
            Role.SP: Signal.good(loop.sp, "SP"),
        },
        interval_s=loop.interval_s,
    )


FAMILIES: Mapping[str, Callable[[LoopToDraw], tuple[Recording, float, str]]] = {
    "own": _own_loop,
    "plant": _plant,
    "wave": _wave,
}


def alarm_score(seen: SeenLoop, shown: Evidence, answer: LoopScore) -> float:
    """The score where all other rules let a loop be suspected, else 0."""
    may_alarm = predicts_better(shown) and estimated_S(shown, answer) >= LEAST_S_PERCENT
    return sticking_score(shown, answer, seen.unit) if may_alarm else 0.0
