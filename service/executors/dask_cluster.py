"""``DaskCluster``: the workers of a Dask scheduler, on this machine or on others.

Dask distributes the work and moves it from a worker that died to another. This module makes sure
that the numbers are the same as on this machine: one thread for each worker, and the same version
of stemwatch everywhere.
"""

from __future__ import annotations

import asyncio
import importlib
import logging
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from threading import Event
from typing import Any

from stemwatch.service import __version__
from stemwatch.service.executors.address import DASK, host_and_port
from stemwatch.service.executors.executor import (
    Answer,
    Batches,
    ExecutorUnavailable,
    Failure,
    Item,
    Result,
    Work,
    failure_of,
    one_thread,
)

log = logging.getLogger(__name__)

CONNECT_S = 10.0
WORKER_S = 60.0  # a cluster may be starting its first worker just now
POLL_S = 0.05  # between two checks for finished batches and for ``stop``
ASK_S = 10.0  # between two requests that show whether the scheduler is alive
SILENT_S = 60.0  # without an answer, after which the scheduler counts as lost
BATCHES_PER_THREAD = 4  # given to the cluster at a time, for each of its threads
WORKERS_DIED = "several workers of the cluster died on it"


class ClusterError(ExecutorUnavailable):
    """A cluster cannot be used; the text says why and what to do."""


@dataclass(frozen=True)
class DaskCluster:
    """The Dask cluster whose scheduler listens at ``scheduler``, as ``HOST:PORT``.

    Each batch goes to one worker, which opens the sources itself: paths must mean the same there as
    here. The work of a worker that dies goes to another; a batch that ends several workers is lost.
    There is no time limit for an item, because a cluster cannot end one batch that hangs without
    ending the worker's other batches. Raises ``ClusterError`` where the extra is not installed,
    nobody answers, no worker comes, or a worker runs another version of the program.
    """

    scheduler: str

    @property
    def workers(self) -> int:
        """How many threads of workers the cluster has now; at least 1."""
        with self._client() as client:
            return max(sum(_threads(client)), 1)

    def hand_out(
        self, work: Work[Item, Result], batches: Batches[Item], stop: Event, *, alone: bool = False
    ) -> Generator[Answer[Result]]:
        """An answer for each batch, until ``stop``, also while no worker answers.

        A batch on which several workers died is lost. It need not be the cause, since a worker
        holds other batches too, unless it is ``alone``. Only a few batches for each worker are at
        the cluster at a time, so that neither the scheduler nor a worker holds more than that.
        """
        if stop.is_set():
            return
        with self._client() as client:
            ahead = 1 if alone else BATCHES_PER_THREAD * max(sum(_threads(client)), 1)
            yield from _SubmittedBatches(client, work, batches, ahead).answers(stop)

    @contextmanager
    def _client(self) -> Iterator[Any]:
        """A connection that is closed at the end of the block."""
        dask, address = distributed(), f"tcp://{self.scheduler}"
        try:
            client = dask.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ClusterError(
                f"dask://{self.scheduler}: no scheduler answers ({error}); start one with "
                "`dask scheduler` and its workers with `dask worker`, or use --executor local"
            ) from None
        try:
            _await_worker(client, self.scheduler)
            yield client
        finally:
            client.close()


def cluster_at(address: str) -> DaskCluster:
    """The cluster at ``dask://HOST:PORT``. Raises ``UnknownExecutor`` for anything else."""
    return DaskCluster(host_and_port(address, DASK))


def distributed() -> Any:
    """The package ``distributed`` (untyped). Raises ``ClusterError`` where it is not installed."""
    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        raise ClusterError(
            "the executor dask:// needs the packages dask and distributed "
            f"({error}); install them with `pip install 'stemwatch[cluster]'`"
        ) from None


class _SubmittedBatches:
    """The batches of one call, of which only a few at a time are at the cluster."""

    def __init__(
        self,
        client: Any,
        work: Callable[[Sequence[Any]], Sequence[Any]],
        batches: Iterable[Sequence[Any]],
        ahead: int,
    ) -> None:
        self._client, self._work, self._ahead = client, work, ahead
        self._waiting = enumerate(batches)
        self._out: dict[str, int] = {}  # places by the futures' keys
        self._scheduler_watch = _SchedulerWatch(client)

    def answers(self, stop: Event) -> Generator[Answer[Any]]:
        """The answer of each batch, until ``stop``."""
        out = distributed().as_completed(self._submit_more(self._ahead), loop=self._client.loop)
        while not out.is_empty() and not stop.is_set():
            self._scheduler_watch.check()
            finished = out.next_batch(block=False)
            if not finished:
                stop.wait(POLL_S)
            for future in finished:
                answer = self._answer(future)
                future.release()  # the cluster may forget it
                out.update(self._submit_more(1))
                yield answer

    def _submit_more(self, count: int) -> list[Any]:
        """Hand out the next ``count`` batches."""
        futures = []
        for index, batch in islice(self._waiting, count):
            future = self._client.submit(
                in_worker, self._work, list(batch), __version__, pure=False
            )
            self._out[future.key] = index
            futures.append(future)
        return futures

    def _answer(self, future: Any) -> Answer[Any]:
        dask = distributed()
        index = self._out.pop(future.key)
        try:
            return Answer(index=index, results=self._result_of(future))
        except dask.KilledWorker:
            return Answer(index=index, failure=Failure(reason=WORKERS_DIED, lost=True))
        except (dask.CancelledError, dask.comm.CommClosedError) as error:
            # Not a failure of the work, which would be a result with its reason.
            raise ClusterError(
                f"the cluster let go of the work ({' '.join(str(error).split())}): its scheduler "
                "was stopped or started anew; run the same command again, what was saved is "
                "updated in place"
            ) from None
        except ClusterError:
            raise
        except Exception as error:
            return Answer(index=index, failure=failure_of(error))

    def _result_of(self, future: Any) -> Any:
        """The result of a finished batch. It has yet to be fetched, and a scheduler that hangs at
        this moment would never say from which worker."""
        patience_s = SILENT_S
        while True:
            try:
                return future.result(timeout=patience_s)
            except TimeoutError:
                if future.status == "error":  # the work's own
                    raise
                self._scheduler_watch.check()
                patience_s *= 2.0  # a large result on a slow line is fetched anew each time


class _SchedulerWatch:
    """Checks whether the scheduler still answers. Work given to one that hangs, or whose network is
    gone without notice, would otherwise be waited for without end."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._asked: Any = None
        self._since_s = time.monotonic()

    def check(self) -> None:
        """Ask at intervals; raises ``ClusterError`` where no answer came for ``SILENT_S``."""
        now_s = time.monotonic()
        if self._asked is not None and self._asked.done():
            # An answer of any kind counts; a broken connection is reported by the work that waits
            # for it.
            self._asked, self._since_s = None, now_s
        elif self._asked is None and now_s - self._since_s >= ASK_S:
            self._since_s = now_s
            question = self._client.scheduler.identity()
            self._asked = asyncio.run_coroutine_threadsafe(question, self._client.loop.asyncio_loop)
        elif self._asked is not None and now_s - self._since_s >= SILENT_S:
            self._asked.cancel()
            raise ClusterError(
                f"the cluster's scheduler has not answered for {SILENT_S:g} s; see whether it and "
                "the network to it work, and run the same command again, what was saved is updated "
                "in place"
            )


def in_worker(
    work: Callable[[Sequence[Item]], Sequence[Result]], batch: Sequence[Item], version: str
) -> Sequence[Result]:
    """``work(batch)`` in a worker of the cluster. Raises ``ClusterError`` for another version."""
    if version != __version__:
        raise ClusterError(
            f"a worker of the cluster runs stemwatch {__version__} and was asked by {version}; "
            "install one version everywhere, or the numbers would not be the same"
        )
    one_thread()
    return work(batch)


def _threads(client: Any) -> list[int]:
    workers = client.scheduler_info(n_workers=-1)["workers"]
    return [int(worker["nthreads"]) for worker in workers.values()]


def _await_worker(client: Any, scheduler: str) -> None:
    """Wait for the first worker; log a warning where workers have several threads."""
    try:
        client.wait_for_workers(1, timeout=WORKER_S)
    except TimeoutError:
        raise ClusterError(
            f"dask://{scheduler}: the scheduler answers but has had no worker for {WORKER_S:g} s; "
            f"start some with `dask worker {scheduler} --nworkers auto --nthreads 1`"
        ) from None
    if max(_threads(client), default=1) > 1:
        log.warning(
            "dask://%s: some workers have several threads, which hinder one another here; "
            "start them with --nthreads 1",
            scheduler,
        )
