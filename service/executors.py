"""Where the work is done: here, or in processes beside this one.

The seam is one method. Every executor gives the same results for the same chunks, in any order.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Protocol, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


class Executor(Protocol):
    """Does ``work`` on each item and yields ``(place, result)`` as soon as it is there.

    An implementation must yield each place once, and raise what ``work`` raises. ``workers`` is how
    many items it does at the same time.
    """

    @property
    def workers(self) -> int: ...

    def map(
        self, work: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[tuple[int, Result]]: ...


@dataclass(frozen=True)
class InProcess:
    """One item after the other, here."""

    workers: int = 1

    def map(
        self, work: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[tuple[int, Result]]:
        for place, item in enumerate(items):
            yield place, work(item)


@dataclass(frozen=True)
class LocalProcesses:
    """``workers`` processes on this machine, each with one thread for its numbers.

    When a worker dies (memory, a crash in a library), what was not finished is done again here,
    one by one, so that a death costs time and not results. When the caller stops asking (Ctrl-C,
    an error), what was not begun is dropped.
    """

    workers: int

    def map(
        self, work: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[tuple[int, Result]]:
        left = dict(enumerate(items))
        if len(left) < 2:  # starting a process would cost more than it brings
            yield from InProcess().map(work, left.values())
            return
        # A spawned worker inherits no threads; a forked one may inherit a lock that nobody holds.
        pool = ProcessPoolExecutor(
            self.workers, mp_context=get_context("spawn"), initializer=prepare_worker
        )
        try:
            places = {pool.submit(work, item): place for place, item in left.items()}
            for future in as_completed(places):
                result = future.result()
                del left[places[future]]
                yield places[future], result
        except BrokenProcessPool:
            pass
        finally:
            pool.shutdown(cancel_futures=True)
        for place, item in left.items():
            yield place, work(item)


def prepare_worker() -> None:
    """One thread for the numbers, and Ctrl-C ends the worker instead of its present item only."""
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def choose_executor(workers: int | None) -> Executor:
    """``workers`` processes; by default one per core."""
    workers = workers or os.cpu_count() or 1
    return LocalProcesses(workers) if workers > 1 else InProcess()
