"""Training and judging what is said of valves without a position, on simulated loops."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.studies.loops.draws import DrawnLoop, draw_loop
from stemwatch.models.studies.loops.examples import LoopExample, example
from stemwatch.models.studies.simulator.draws import draw_healthy, draw_sticky
from stemwatch.models.studies.simulator.simulate import simulate_loop
from stemwatch.models.without_position.features import NAMES
from stemwatch.models.without_position.network import LoopScore
from stemwatch.models.without_position.suspicion import (
    BEYOND,
    Judge,
    SeenLoop,
    Suspicion,
    SuspicionLimits,
    look,
)
from stemwatch.service.executors import Executor, map_in_order

FALSE_ALARMS = 0.02  # share of sound loops that may be suspected
MISSED = 0.05  # share of loops that plainly stick which may be told "no sign"
PLAIN = 0.5  # S over the amplitude of OP, from which a loop plainly sticks
SEEN = 0.9  # share of sticking loops of an S, and of any larger, that are not told "no sign"
_NEAR, _ENOUGH = 1.5, 30  # S and all down to so many times less count together, if so many
_BEYOND_AT = NAMES.index("gain of both beyond its surrogates")


@dataclass(frozen=True)
class LoopToDraw:
    """One loop to draw: seed, place, and the family it is of."""

    seed: int
    place: int
    family: str = "own"


def example_item(item: LoopToDraw) -> list[LoopExample | None]:
    """The example of one drawn loop."""
    return [example(item.seed, item.place)]


def run_training(
    loops: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> Judge:
    """Train on ``loops`` loops of ``seed``; half as many of the next seed give the limits."""
    from stemwatch.models.studies.loops.training import train  # torch takes two seconds to import

    items = [LoopToDraw(seed, place) for place in range(loops)]
    items += [LoopToDraw(seed + 1, place) for place in range(loops // 2)]
    examples = map_in_order(executor, example_item, items, on_progress)
    network = train([one for one in examples[:loops] if one is not None], seed=seed)
    judged = [one for one in examples[loops:] if one is not None]
    answers = [network.answer(one.values, one.windows.astype(np.float64)) for one in judged]
    return Judge(network=network, limits=_limits(judged, answers))


def _limits(judged: Sequence[LoopExample], answers: Sequence[LoopScore]) -> SuspicionLimits:
    score = np.array([answer.score for answer in answers])
    sticky = np.array([one.sticky for one in judged])
    size = np.exp(np.nan_to_num([one.log_S for one in judged], nan=-9.0))
    beyond = np.array([one.values[_BEYOND_AT] for one in judged]) > BEYOND
    suspected = float(np.quantile(np.where(beyond, score, 0.0)[~sticky], 1.0 - FALSE_ALARMS))
    no_sign = min(float(np.quantile(score[sticky & (size >= PLAIN)], MISSED)), suspected)
    # A valve that sticks by more than OP swings would make it swing wider.
    tried = np.geomspace(0.05, 1.0, 60)
    shows = tried[-1]
    for least in tried[::-1]:
        near = sticky & (size > least / _NEAR) & (size <= least)
        if near.sum() >= _ENOUGH and float(np.mean(score[near] >= no_sign)) < SEEN:
            break
        shows = least
    return SuspicionLimits(suspected_from=suspected, no_sign_below=no_sign, shows_from=float(shows))


@dataclass(frozen=True, kw_only=True)
class StudiedLoop:
    """What was said of one simulated loop, and the truth. ``S`` is 0 where nothing sticks."""

    family: str
    story: str
    S: float
    verdict: Suspicion
    score: float | None
    apparent_S: tuple[float, float, float] | None  # value, low, high

    @property
    def sticky(self) -> bool:
        """Whether the valve sticks."""
        return self.S > 0.0


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
    return [SeenDraw(place=item, story=story, S=S, seen=look(recording))]


def _answer(judge: Judge, shown: SeenDraw) -> StudiedLoop:
    said = judge.says(shown.seen)
    estimate = said.apparent_S
    numbers = None
    if estimate.value is not None and estimate.low is not None and estimate.high is not None:
        numbers = (estimate.value, estimate.low, estimate.high)
    return StudiedLoop(
        family=shown.place.family,
        story=shown.story,
        S=shown.S,
        verdict=said.verdict,
        score=said.score,
        apparent_S=numbers,
    )


def _own(item: LoopToDraw, story: str = "") -> tuple[Recording, float, str]:
    loop = draw_loop(item.seed, item.place, story)
    return _recording(loop, f"LOOP-{item.place}"), loop.S, loop.story


def _wave(item: LoopToDraw) -> tuple[Recording, float, str]:
    return _own(item, "wave")


def _plant(item: LoopToDraw) -> tuple[Recording, float, str]:
    """The force-balance plant of ``stemwatch trial``, without its position."""
    sticks = item.place % 2 == 0
    loop = (draw_sticky if sticks else draw_healthy)(item.place // 2 + 1, item.seed)[-1]
    recording = simulate_loop(loop, item.seed * 1_000 + item.place).recording
    signals = dict(recording.signals)
    del signals[Role.MV]
    S = loop.valve.S_read if sticks else 0.0
    return replace(recording, signals=signals), S, loop.story


def _recording(loop: DrawnLoop, valve: str) -> Recording:
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
    "own": _own,
    "plant": _plant,
    "wave": _wave,
}


def run_position_free(
    judge: Judge, loops: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> list[StudiedLoop]:
    """What ``judge`` says of ``loops`` loops of each family, every other one sticking."""
    items = [LoopToDraw(seed, place, family) for family in FAMILIES for place in range(loops)]
    return [
        _answer(judge, shown) for shown in map_in_order(executor, look_item, items, on_progress)
    ]


@dataclass(frozen=True, kw_only=True)
class FamilyRow:
    """What came out for one family: counts, and shares of 0 to 1.

    ``auc`` and ``sensitivity`` (at 2 and 5 % false alarms) are of the score, all loops counted, a
    missing score as 0. ``error`` is the median error of S of the suspected, percent; ``held`` how
    many of their intervals hold the truth.
    """

    family: str
    sticking: int
    sound: int
    suspected: tuple[int, int]  # sticking, sound
    no_sign: tuple[int, int]
    cannot_tell: tuple[int, int]
    auc: float
    sensitivity: tuple[float, float]
    error: float
    held: tuple[int, int]


def family_rows(answers: Sequence[StudiedLoop]) -> Iterator[FamilyRow]:
    """One row for each family, in the order in which they were asked."""
    for family in dict.fromkeys(answer.family for answer in answers):
        yield _family_row(family, [answer for answer in answers if answer.family == family])


def _family_row(family: str, answers: Sequence[StudiedLoop]) -> FamilyRow:
    sticky = np.array([answer.sticky for answer in answers])
    score = np.array([answer.score or 0.0 for answer in answers])
    good, bad = score[sticky], score[~sticky]
    above = (good[:, None] > bad[None]) + 0.5 * (good[:, None] == bad[None])
    right = [a for a in answers if a.sticky and a.apparent_S is not None]
    errors = [abs(a.apparent_S[0] - a.S) for a in right if a.apparent_S]
    held = sum(a.apparent_S[1] <= a.S <= a.apparent_S[2] for a in right if a.apparent_S)

    def count(verdict: Suspicion) -> tuple[int, int]:
        said = np.array([answer.verdict is verdict for answer in answers])
        return int(np.sum(said & sticky)), int(np.sum(said & ~sticky))

    return FamilyRow(
        family=family,
        sticking=int(sticky.sum()),
        sound=int(np.sum(~sticky)),
        suspected=count(Suspicion.SUSPECTED),
        no_sign=count(Suspicion.NO_SIGN),
        cannot_tell=count(Suspicion.CANNOT_TELL),
        auc=float(above.mean()),
        sensitivity=(_sensitivity(good, bad, 0.02), _sensitivity(good, bad, 0.05)),
        error=float(np.median(errors)) if errors else float("nan"),
        held=(int(held), len(right)),
    )


def _sensitivity(good: Floats, bad: Floats, alarms: float) -> float:
    """The share of ``good`` above all but a share ``alarms`` of ``bad``."""
    return float(np.mean(good > np.quantile(bad, 1.0 - alarms)))
