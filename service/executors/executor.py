"""``Executor``: the seam to whatever does the work, and what every worker is told first."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


class Executor(Protocol):
    """Does ``work`` on each item and yields ``(place, result)`` as soon as it is there.

    An implementation must yield each place once, in any order, raise what ``work`` raises, and do
    again elsewhere what a worker that died had not finished. ``workers`` is how many items it does
    at the same time.
    """

    @property
    def workers(self) -> int:
        """How many items are worked on at the same time."""
        ...

    def map(
        self, work: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[tuple[int, Result]]:
        """``(place, work(item))`` for each item, in the order in which they are done."""
        ...


def one_thread() -> None:
    """One thread for the numbers of this process.

    Workers then do not fight for cores, and a sum is added up in one order wherever it is done:
    that is what makes results equal number for number. Libraries that are not loaded yet hear it
    from the environment, those that are from their own switch.
    """
    for name in THREADS:
        os.environ[name] = "1"
    torch = sys.modules.get("torch")
    if torch is not None and torch.get_num_threads() != 1:
        torch.set_num_threads(1)
