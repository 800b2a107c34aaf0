"""``InProcess``: the work is done here, one item after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from stemwatch.service.executors.executor import Item, Result


@dataclass(frozen=True)
class InProcess:
    """One item after the other, here. Items are taken as they are needed."""

    workers: int = 1

    def map(
        self, work: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[tuple[int, Result]]:
        """``(place, work(item))`` for each item, in order."""
        for place, item in enumerate(items):
            yield place, work(item)
