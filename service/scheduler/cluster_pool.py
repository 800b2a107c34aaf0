"""``ClusterPool``: a run's batches on a Dask cluster instead of processes beside this one."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from stemwatch.service.executors import Executor, choose_executor
from stemwatch.service.scheduler.workers import Item, Outcome, Result, WorkerPool

log = logging.getLogger(__name__)


class ClusterPool(WorkerPool):
    """Does batches where ``executor`` (``dask://HOST:PORT``) says.

    A batch that fails is done again item by item, as in ``WorkerPool``, and a worker that dies
    costs time only. What a cluster cannot do is to end one item that hangs without ending what
    else that worker has: there is no time limit for an item.
    """

    def __init__(self, executor: str) -> None:
        super().__init__(workers=1, item_timeout_s=0.0)
        self._executor: Executor = choose_executor(None, executor)

    @property
    def workers(self) -> int:
        """How many batches are done at a time."""
        return self._executor.workers

    def each(
        self,
        work: Callable[[list[Item]], Sequence[Result]],
        batches: Sequence[Sequence[Item]],
        stop: threading.Event,
    ) -> Iterator[Outcome[Item, Result]]:
        """An outcome for each item, as soon as it is there. Ends early when ``stop`` is set."""
        waiting = [list(batch) for batch in batches if batch]
        while waiting and not stop.is_set():
            again: list[list[Item]] = []
            for place, (results, reason) in self._executor.map(partial(answer, work), waiting):
                batch = waiting[place]
                if not reason:
                    for item, result in zip(batch, results, strict=True):
                        yield Outcome(item, result)
                elif len(batch) > 1:
                    log.warning("a batch of %d: %s; done again one by one", len(batch), reason)
                    again += [[item] for item in batch]
                else:
                    yield Outcome(batch[0], None, reason)
                if stop.is_set():
                    return
            waiting = again


def answer(work: Callable[[list[Any]], Sequence[Any]], batch: list[Any]) -> tuple[list[Any], str]:
    """The results of a batch, or none and the reason: an error costs its batch, not the run."""
    try:
        return list(work(batch)), ""
    except Exception as error:
        return [], f"{type(error).__name__}: {error}"[:500]
