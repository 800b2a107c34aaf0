"""``DaskCluster``: the workers of a Dask scheduler, on this machine or on others.

The distributing is Dask's: it moves work from a worker that died to one that lives. What is ours is
that the numbers are the same as here: one thread each, and the same version on either side.
"""

from __future__ import annotations

import importlib
import logging
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Any

from stemwatch.service import __version__
from stemwatch.service.executors.executor import Item, Result, one_thread

log = logging.getLogger(__name__)

CONNECT_S = 10.0
WORKER_S = 60.0  # a cluster may be starting its first worker just now
LOOK_S = 0.05  # between two looks at what is done, and whether it is still wanted
AHEAD = 4  # pieces of work that wait at the cluster for each that is worked on


class ClusterError(OSError):
    """A cluster cannot be used; the sentence says why and what to do."""


@dataclass(frozen=True)
class DaskCluster:
    """The Dask cluster whose scheduler listens at ``scheduler``, as ``HOST:PORT``.

    Each piece of work goes to one worker, which opens the sources itself: paths must mean the same
    there as here. A worker that dies costs time: its work goes to another, and what ended several
    workers is done here. Raises ``ClusterError`` where the extra is not installed, nobody answers,
    no worker comes, or a worker runs another version of the program.
    """

    scheduler: str

    @property
    def workers(self) -> int:
        """How many threads of workers the cluster has now; at least 1."""
        with self._client() as client:
            return max(sum(_threads(client)), 1)

    def map(
        self, work: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[tuple[int, Result]]:
        """``(place, work(item))`` for each item, as they are done."""

        def here(item: Item) -> Result:
            log.warning("several workers died on one piece of work; it is done here")
            return work(item)

        yield from self.hand_out(work, items, here, threading.Event())

    def hand_out(
        self,
        work: Callable[[Item], Result],
        items: Iterable[Item],
        deadly: Callable[[Item], Result],
        stop: threading.Event,
    ) -> Iterator[tuple[int, Result]]:
        """``map`` that ends when ``stop`` is set, also while no worker answers.

        An item on which several workers died has the result ``deadly(item)``; it need not be the
        one that ended them, as a worker holds others too. Only a few pieces for each worker are at
        the cluster at a time, so that neither the scheduler nor a worker holds more than that,
        however many items there are.
        """
        with self._client() as client:
            yield from _Handing(client, work, items, deadly).results(stop)

    @contextmanager
    def _client(self) -> Iterator[Any]:
        """A connection that closes when it is no longer needed."""
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


def distributed() -> Any:
    """The package, without types. Raises ``ClusterError`` where it is not installed."""
    try:
        return importlib.import_module("distributed")
    except ImportError as error:
        raise ClusterError(
            "the executor dask:// needs the packages dask and distributed "
            f"({error}); install them with `pip install 'stemwatch[cluster]'`"
        ) from None


class _Handing:
    """The work of one call on its way: a few pieces out, the rest here."""

    def __init__(
        self,
        client: Any,
        work: Callable[[Any], Any],
        items: Iterable[Any],
        deadly: Callable[[Any], Any],
    ) -> None:
        self._client, self._work, self._deadly = client, work, deadly
        self._waiting = enumerate(items)
        self._out: dict[str, tuple[int, Any]] = {}  # by the future's key

    def results(self, stop: threading.Event) -> Iterator[tuple[int, Any]]:
        """Each place with its result, until ``stop``."""
        ahead = AHEAD * max(sum(_threads(self._client)), 1)
        out = distributed().as_completed(self._more(ahead), loop=self._client.loop)
        while not out.is_empty() and not stop.is_set():
            done = out.next_batch(block=False)
            if not done:
                stop.wait(LOOK_S)
            for future in done:
                place, item = self._out.pop(future.key)
                result = self._result(future, item)
                future.release()  # the cluster may forget it
                out.update(self._more(1))
                yield place, result

    def _more(self, count: int) -> list[Any]:
        """Hand out the next ``count`` pieces."""
        futures = []
        for place, item in islice(self._waiting, count):
            future = self._client.submit(in_worker, self._work, item, __version__, pure=False)
            self._out[future.key] = place, item
            futures.append(future)
        return futures

    def _result(self, future: Any, item: Any) -> Any:
        dask = distributed()
        try:
            return future.result()
        except dask.KilledWorker:
            return self._deadly(item)
        except dask.CancelledError as error:
            raise ClusterError(
                f"the cluster let go of the work ({error}): its scheduler was stopped or started "
                "anew; run the same command again, what was saved is updated in place"
            ) from None


def in_worker(work: Callable[[Item], Result], item: Item, version: str) -> Result:
    """``work(item)`` in a worker of the cluster. Raises ``ClusterError`` for another version."""
    if version != __version__:
        raise ClusterError(
            f"a worker of the cluster runs stemwatch {__version__} and was asked by {version}; "
            "install one version everywhere, or the numbers would not be the same"
        )
    one_thread()
    return work(item)


def _threads(client: Any) -> list[int]:
    workers = client.scheduler_info(n_workers=-1)["workers"]
    return [int(worker["nthreads"]) for worker in workers.values()]


def _await_worker(client: Any, scheduler: str) -> None:
    """Wait for the first worker, and say so where workers have several threads."""
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
