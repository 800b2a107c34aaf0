"""Searches that go on in step, so that the runs they ask for fill the kernel's lanes.

One search asks for a few runs at a time and cannot go on before it knows what they cost. Written
as a generator it hands out what it asks for and waits; several of them are then answered at once.
What each finds does not depend on its company.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable
from typing import TypeAlias, TypeVar

from stemwatch.models.mismatch.evaluator import Evaluator, RunRequest

T = TypeVar("T")
Search: TypeAlias = Generator[list[RunRequest], None, T]


def run_together(searches: Iterable[Search[T]]) -> Search[list[T]]:
    """What some searches find, in their order; each round asks for what all of them ask for."""
    going = dict(enumerate(searches))
    answers: dict[int, T] = {}
    while going:
        asks: list[RunRequest] = []
        for number, search in list(going.items()):
            try:
                asks += next(search)
            except StopIteration as end:
                answers[number] = end.value
                del going[number]
        if asks:
            yield asks
    return [answers[number] for number in sorted(answers)]


def conclude(evaluator: Evaluator, search: Search[T]) -> T:
    """Answer what a search asks for until it is done."""
    while True:
        try:
            asks = next(search)
        except StopIteration as end:
            answer: T = end.value
            return answer
        evaluator.answer(asks)
