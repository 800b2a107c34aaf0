"""What is said of simulated loops without a position, beside the truth, counted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.without_position.suspicion import (
    ENOUGH_PERIODS,
    Judge,
    Suspicion,
)
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.detection_rates import area_under_roc, sensitivity
from stemwatch.service.studies.without_position.draw import (
    FAMILIES,
    LoopToDraw,
    SeenDraw,
    alarm_score,
    look_item,
)


@dataclass(frozen=True, kw_only=True)
class StudiedLoop:
    """What was said of one simulated loop, and the truth. ``S`` is 0 where nothing sticks."""

    family: str
    story: str
    S: float
    swings: float  # periods of the loop in its record; 0 where there was nothing to judge
    verdict: Suspicion
    score: float | None
    apparent_S: tuple[float, float, float] | None  # value, low, high
    shows_from: float | None = None  # the S that would have shown, with "no sign"
    alarm: float = 0.0  # the score where all other rules let it be suspected

    @property
    def sticky(self) -> bool:
        """Whether the valve sticks."""
        return self.S > 0.0

    @property
    def should_have_shown(self) -> bool:
        """Whether it sticks by the S, or more, that is said to have shown."""
        return self.shows_from is not None and self.S >= self.shows_from


def studied(judge: Judge, seen_draw: SeenDraw) -> StudiedLoop:
    """What ``judge`` says of a simulated loop, beside its truth."""
    suspicion = judge.says(seen_draw.seen)
    shown, windows = seen_draw.seen.shown, seen_draw.seen.windows
    alarm = 0.0
    if shown is not None and windows is not None and seen_draw.seen.doubt is None:
        alarm = alarm_score(seen_draw.seen, shown, judge.network.answer(shown.values, windows))
    return StudiedLoop(
        family=seen_draw.place.family,
        story=seen_draw.story,
        S=seen_draw.S,
        swings=0.0 if shown is None else seen_draw.seen.samples / shown.period,
        verdict=suspicion.verdict,
        score=suspicion.score,
        apparent_S=suspicion.apparent_S.with_interval,
        shows_from=suspicion.shows_from,
        alarm=alarm,
    )


def run_study(
    judge: Judge, loops: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> list[StudiedLoop]:
    """What ``judge`` says of ``loops`` loops of each family, every other one sticking."""
    items = [LoopToDraw(seed, index, family) for family in FAMILIES for index in range(loops)]
    return [
        studied(judge, seen_draw)
        for seen_draw in map_in_order(executor, look_item, items, on_progress)
    ]


@dataclass(frozen=True, kw_only=True)
class FamilyRow:
    """What came out for one family: counts, and shares of 0 to 1.

    ``auc`` and ``sensitivity`` (at 2 and 5 % false alarms) are of the score, all loops counted, a
    missing score as 0; ``found`` is the sensitivity of suspicions, where a loop that another rule
    keeps from being suspected is no false alarm and is not found. ``missed`` counts the sticking
    ones whose S should have shown by what was said. ``error`` is the median error of
    S of the suspected, percent; ``held`` how many of their intervals hold the truth.
    """

    family: str
    sticking: int
    sound: int
    suspected: tuple[int, int]  # sticking, sound
    no_sign: tuple[int, int]
    cannot_tell: tuple[int, int]
    missed: int
    auc: float
    sensitivity: tuple[float, float]
    found: tuple[float, float]
    error: float
    held: tuple[int, int]


def family_rows(answers: Sequence[StudiedLoop]) -> Iterator[FamilyRow]:
    """One row for each family, in the order in which they were asked, and one for those of its
    loops whose record holds ``ENOUGH_PERIODS`` and more."""
    for family in dict.fromkeys(answer.family for answer in answers):
        of_family = [answer for answer in answers if answer.family == family]
        yield _family_row(family, of_family)
        long = [answer for answer in of_family if answer.swings >= ENOUGH_PERIODS]
        if {answer.sticky for answer in long} == {True, False}:
            yield _family_row(f"{family}, {ENOUGH_PERIODS} swings and more", long)


def _family_row(family: str, answers: Sequence[StudiedLoop]) -> FamilyRow:
    sticky = np.array([answer.sticky for answer in answers])
    score = np.array([answer.score or 0.0 for answer in answers])
    good, bad = score[sticky], score[~sticky]
    alarm = np.array([answer.alarm for answer in answers])
    alarms = alarm[sticky], alarm[~sticky]
    right = [a for a in answers if a.sticky and a.apparent_S is not None]
    errors = [abs(a.apparent_S[0] - a.S) for a in right if a.apparent_S]
    covered = sum(a.apparent_S[1] <= a.S <= a.apparent_S[2] for a in right if a.apparent_S)

    def count(verdict: Suspicion) -> tuple[int, int]:
        is_verdict = np.array([answer.verdict is verdict for answer in answers])
        return int(np.sum(is_verdict & sticky)), int(np.sum(is_verdict & ~sticky))

    return FamilyRow(
        family=family,
        sticking=int(sticky.sum()),
        sound=int(np.sum(~sticky)),
        suspected=count(Suspicion.SUSPECTED),
        no_sign=count(Suspicion.NO_SIGN),
        cannot_tell=count(Suspicion.CANNOT_TELL),
        missed=sum(answer.should_have_shown for answer in answers),
        auc=area_under_roc(good, bad),
        sensitivity=(sensitivity(good, bad, 0.02), sensitivity(good, bad, 0.05)),
        found=(sensitivity(*alarms, 0.02), sensitivity(*alarms, 0.05)),
        error=float(np.median(errors)) if errors else float("nan"),
        held=(int(covered), len(right)),
    )
