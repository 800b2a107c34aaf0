"""``LocalProcesses``: worker processes on this machine."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

from stemwatch.service.executors.executor import Item, Result, one_thread
from stemwatch.service.executors.in_process import InProcess
from stemwatch.service.process_lifecycle import (
    begin_child,
    environment,
    quiet_start,
    take_environment,
    worker_context,
)

log = logging.getLogger(__name__)

# A pool that broke is started again for what is left; one that breaks so often has an item in it
# that ends every worker, or a machine without memory for so many.
MOST_POOLS = 3


@dataclass(frozen=True)
class LocalProcesses:
    """``workers`` processes on this machine, each with one thread for its numbers.

    When a worker dies (killed, out of memory, a crash in a library), fresh workers do what was not
    finished; after ``MOST_POOLS`` deaths the rest is done here, one by one. A death costs time and
    not results. When the caller stops asking (Ctrl-C, an error), what was not begun is dropped.
    """

    workers: int

    def map(
        self, work: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[tuple[int, Result]]:
        """``(place, work(item))`` for each item, as they are done."""
        left = dict(enumerate(items))
        if len(left) < 2:  # starting a process would cost more than it brings
            yield from InProcess().map(work, left.values())
            return
        for _ in range(MOST_POOLS):
            for place, result in self._in_a_pool(work, dict(left)):
                del left[place]
                yield place, result
            if not left:
                return
            log.warning("a worker process died; %d pieces of work are done again", len(left))
        for place, item in left.items():
            yield place, work(item)

    def _in_a_pool(
        self, work: Callable[[Item], Result], items: dict[int, Item]
    ) -> Iterator[tuple[int, Result]]:
        """What one pool gets done: everything, or what was finished before a worker died."""
        pool = ProcessPoolExecutor(
            self.workers,
            mp_context=worker_context(),
            initializer=prepare_worker,
            initargs=(environment(),),
        )
        try:
            with quiet_start():  # it is here that the processes begin
                places = {pool.submit(work, item): place for place, item in items.items()}
            for future in as_completed(list(places)):
                place = places.pop(future)  # the future, and the result in it, is let go
                yield place, future.result()
        except BrokenProcessPool:
            pass
        finally:
            pool.shutdown(cancel_futures=True)


def prepare_worker(environment: Mapping[str, str]) -> None:
    """One thread for the numbers; Ctrl-C ends the worker instead of its present item only, and it
    ends with its parent."""
    take_environment(environment)
    one_thread()
    begin_child()
