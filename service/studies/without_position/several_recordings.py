"""How many sticking and sound loops are suspected by one recording, and by several together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from stemwatch.models.studies.loops.draws import draw_recordings
from stemwatch.models.without_position.several_recordings import (
    LAST_THAT_COUNT,
    of_loop,
    suspected_together,
)
from stemwatch.models.without_position.suspicion import (
    Suspicion,
    WithoutPosition,
    look_at_loop,
    trained_judge,
)
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.without_position.draw import recording_of

NUMBERS = (1, 2, 3, 4, 6, 8, 12, 16)


@dataclass(frozen=True)
class LoopToRecord:
    """Loop ``place`` of ``seed``, to be recorded ``recordings`` times."""

    seed: int
    place: int
    recordings: int


@dataclass(frozen=True, kw_only=True)
class RecordedLoop:
    """Whether a loop sticks, and what each of its recordings says."""

    sticky: bool
    answers: tuple[WithoutPosition, ...]


@dataclass(frozen=True, kw_only=True)
class TogetherRow:
    """How many loops, sticking and sound, are suspected by their first ``recordings``: by all of
    them together, where any one is, and where at least half of them are."""

    recordings: int
    together: tuple[int, int]
    any_one: tuple[int, int]
    half: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class InOrderRow:
    """How many loops, sticking and sound, are suspected where their recordings come one after the
    other: after the last, and after any of them."""

    by: str
    at_the_end: tuple[int, int]
    at_some_time: tuple[int, int]


def record_item(item: LoopToRecord) -> list[RecordedLoop]:
    """Draw the recordings of one loop, and ask of each."""
    judge = trained_judge()
    drawn = draw_recordings(item.seed, item.place, item.recordings)
    looks = (look_at_loop(recording_of(loop, f"LOOP-{item.place}")) for loop in drawn)
    return [RecordedLoop(sticky=drawn[0].sticky, answers=tuple(judge.says(seen) for seen in looks))]


def run_several_recordings(
    loops: int, recordings: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> list[RecordedLoop]:
    """What is said of ``loops`` loops, every other one sticking, by ``recordings`` of each."""
    items = [LoopToRecord(seed, place, recordings) for place in range(loops)]
    return map_in_order(executor, record_item, items, on_progress)


def together_rows(loops: Sequence[RecordedLoop]) -> Iterator[TogetherRow]:
    """A row for each of ``NUMBERS`` up to as many recordings as there are."""

    def suspected(by: Callable[[Sequence[WithoutPosition]], bool], count: int) -> tuple[int, int]:
        return _counts(loops, [by(loop.answers[:count]) for loop in loops])

    for count in NUMBERS:
        if count <= min(len(loop.answers) for loop in loops):
            yield TogetherRow(
                recordings=count,
                together=suspected(suspected_together, count),
                any_one=suspected(lambda answers: _suspicions(answers) > 0, count),
                half=suspected(lambda answers: 2 * _suspicions(answers) >= len(answers), count),
            )


def in_order_rows(loops: Sequence[RecordedLoop]) -> Iterator[InOrderRow]:
    """By the newest recording alone, and by the last ones together, as the service counts."""
    alone = [[answer.verdict for answer in loop.answers] for loop in loops]
    together = [
        [
            of_loop(newest, loop.answers[:place][::-1]).verdict
            for place, newest in enumerate(loop.answers)
        ]
        for loop in loops
    ]
    for by, verdicts in (
        ("the newest alone", alone),
        (f"the last {LAST_THAT_COUNT} together", together),
    ):
        at_the_end = [each[-1] is Suspicion.SUSPECTED for each in verdicts]
        at_some_time = [Suspicion.SUSPECTED in each for each in verdicts]
        yield InOrderRow(
            by=by, at_the_end=_counts(loops, at_the_end), at_some_time=_counts(loops, at_some_time)
        )


def _counts(loops: Sequence[RecordedLoop], found: Sequence[bool]) -> tuple[int, int]:
    """How many of the ``found`` loops stick, and how many are sound."""
    sticky = [loop.sticky for loop, is_found in zip(loops, found, strict=True) if is_found]
    return sum(sticky), len(sticky) - sum(sticky)


def _suspicions(answers: Sequence[WithoutPosition]) -> int:
    return sum(answer.verdict is Suspicion.SUSPECTED for answer in answers)
