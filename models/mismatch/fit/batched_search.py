"""Searches that advance together, so that the runs they request fill the kernel's lanes.

One search requests a few runs at a time and cannot go on before it knows their losses. It is
written as a generator, which yields its requests and waits; the requests of several searches are
then run as one batch. The result of each search does not depend on the others.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable
from typing import TypeAlias, TypeVar

from stemwatch.models.mismatch.fit.evaluator import Evaluator, RunRequest

T = TypeVar("T")
Search: TypeAlias = Generator[list[RunRequest], None, T]


def run_together(searches: Iterable[Search[T]]) -> Search[list[T]]:
    """The results of several searches, in their order; each round merges the requests of all of
    them.
    """
    going = dict(enumerate(searches))
    answers: dict[int, T] = {}
    while going:
        requests: list[RunRequest] = []
        for number, search in list(going.items()):
            try:
                requests += next(search)
            except StopIteration as end:
                answers[number] = end.value
                del going[number]
        if requests:
            yield requests
    return [answers[number] for number in sorted(answers)]


def conclude(evaluator: Evaluator, search: Search[T]) -> T:
    """Run the requests of a search until it returns."""
    while True:
        try:
            requests = next(search)
        except StopIteration as end:
            answer: T = end.value
            return answer
        evaluator.answer(requests)
