"""``ClusterPool``: a run's batches on a Dask cluster instead of processes beside this one."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

from stemwatch.service.executors import cluster_at
from stemwatch.service.scheduler.workers import Item, Outcome, Result, WorkerPool

log = logging.getLogger(__name__)

DEADLY = "several workers of the cluster died on it"
Answer = tuple[list[Any], str]  # the results of a batch, or none and the reason


class ClusterPool(WorkerPool):
    """Does batches where ``executor`` (``dask://HOST:PORT``) says.

    A batch that fails is done again item by item, as in ``WorkerPool``, and a worker that dies
    costs time only. An item that ends several workers is given up with that reason: done in this
    process it would end the service. What a cluster cannot do is to end one item that hangs
    without ending what else that worker has: there is no time limit for an item.
    """

    def __init__(self, executor: str) -> None:
        super().__init__(workers=1, item_timeout_s=0.0)
        self._cluster = cluster_at(executor)

    @property
    def workers(self) -> int:
        """How many batches are done at a time."""
        return self._cluster.workers

    def each(
        self,
        work: Callable[[list[Item]], Sequence[Result]],
        batches: Sequence[Sequence[Item]],
        stop: threading.Event,
    ) -> Iterator[Outcome[Item, Result]]:
        """An outcome for each item, as soon as it is there. Ends early when ``stop`` is set."""
        again: list[Item] = []
        for batch, (results, reason) in self._answers(work, batches, stop):
            if not reason:
                for item, result in zip(batch, results, strict=True):
                    yield Outcome(item, result)
            elif len(batch) == 1 and reason != DEADLY:
                yield Outcome(batch[0], None, reason)
            else:
                log.warning("a batch of %d: %s; done again one by one", len(batch), reason)
                again += batch
        # Nothing else of this run is at the cluster meanwhile: workers that die died of this item.
        for item in again:
            for _, (results, reason) in self._answers(work, [[item]], stop):
                yield Outcome(item, None if reason else results[0], reason)

    def _answers(
        self,
        work: Callable[[list[Item]], Sequence[Result]],
        batches: Sequence[Sequence[Item]],
        stop: threading.Event,
    ) -> Iterator[tuple[list[Item], Answer]]:
        """Each batch with its answer, as they come, until ``stop``."""
        waiting = [list(batch) for batch in batches if batch]
        if not waiting or stop.is_set():
            return
        found = self._cluster.hand_out(partial(answer, work), waiting, _ended_workers, stop)
        for place, answered in found:
            yield waiting[place], answered


def _ended_workers(_: list[Any]) -> Answer:
    return [], DEADLY


def answer(work: Callable[[list[Any]], Sequence[Any]], batch: list[Any]) -> Answer:
    """The results of a batch, or none and the reason: an error costs its batch, not the run."""
    try:
        return list(work(batch)), ""
    except Exception as error:
        return [], f"{type(error).__name__}: {error}"[:500]
