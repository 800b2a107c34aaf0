"""``WorkerPool``: processes beside this one, each of which may hang or die without harm.

A batch that takes too long, or whose worker dies, is done again item by item, so that one bad
valve costs its batch some time and nobody else anything; the item that does it again is given up
with a reason.
"""

from __future__ import annotations

import contextlib
import logging
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Generic, TypeVar

from stemwatch.service.executors.executor import one_thread
from stemwatch.service.logs import logs_as_parent
from stemwatch.service.process_lifecycle import (
    begin_child,
    environment,
    quiet_start,
    take_environment,
    worker_context,
)

log = logging.getLogger(__name__)

Item = TypeVar("Item")
Result = TypeVar("Result")

_STARTING_S = 60.0  # importing and compiling in a fresh process, beside the items' own time
_LOOK_S = 0.5


@dataclass(frozen=True)
class Outcome(Generic[Item, Result]):
    """What became of one item: its result, or the reason why there is none."""

    item: Item
    result: Result | None
    reason: str = ""


@dataclass
class _Worker:
    process: BaseProcess
    pipe: Connection
    batch: list[Any]
    until: float = 0.0
    fresh: bool = True


class WorkerPool:
    """Does ``work`` on batches of items in ``workers`` processes.

    ``work`` takes a list of items and gives a result for each, in order; it travels by its name.
    ``item_timeout_s`` is what one item may take.
    """

    def __init__(self, workers: int, item_timeout_s: float) -> None:
        self._count, self._timeout_s = workers, item_timeout_s
        self._context = worker_context()

    def each(
        self,
        work: Callable[[list[Item]], Sequence[Result]],
        batches: Sequence[Sequence[Item]],
        stop: threading.Event,
    ) -> Iterator[Outcome[Item, Result]]:
        """An outcome for each item, as soon as it is there. Ends early when ``stop`` is set."""
        waiting: deque[list[Any]] = deque(list(batch) for batch in batches if batch)
        idle: list[_Worker] = []
        busy: list[_Worker] = []
        try:
            while (waiting or busy) and not stop.is_set():
                while waiting and len(busy) < self._count:
                    worker = idle.pop() if idle else self._start(work)
                    self._give(worker, waiting.popleft())
                    busy.append(worker)
                for worker in _ready(busy):
                    busy.remove(worker)
                    outcomes, again = self._take(worker, idle)
                    waiting.extendleft([item] for item in reversed(again))
                    yield from outcomes
        finally:
            for worker in (*idle, *busy):
                _end(worker)

    def _start(self, work: Callable[[list[Item]], Sequence[Result]]) -> _Worker:
        ours, theirs = self._context.Pipe()
        process = self._context.Process(
            target=_serve, args=(theirs, work, environment()), daemon=True
        )
        with quiet_start():
            process.start()
        theirs.close()
        return _Worker(process, ours, [])

    def _give(self, worker: _Worker, batch: list[Any]) -> None:
        worker.batch = batch
        starting = _STARTING_S if worker.fresh else 0.0
        worker.until = time.monotonic() + starting + self._timeout_s * len(batch)
        worker.fresh = False
        with contextlib.suppress(OSError):  # it died: seen when its answer is taken
            worker.pipe.send(batch)

    def _take(
        self, worker: _Worker, idle: list[_Worker]
    ) -> tuple[list[Outcome[Any, Any]], list[Any]]:
        """The outcomes of a worker's batch, and the items that are to be done again alone."""
        try:
            answer = worker.pipe.recv() if worker.pipe.poll() else None
        except (EOFError, OSError):
            answer = None
        if answer is not None:
            idle.append(worker)
            results, reason = answer
            if not reason:
                pairs = zip(worker.batch, results, strict=True)
                return [Outcome(item, result) for item, result in pairs], []
        else:
            reason = self._why_nothing(worker)
            _end(worker)
        if len(worker.batch) > 1:
            log.warning("a batch of %d: %s; done again one by one", len(worker.batch), reason)
            return [], worker.batch
        return [Outcome(item, None, reason) for item in worker.batch], []

    def _why_nothing(self, worker: _Worker) -> str:
        worker.process.join(timeout=0.2)  # it may be dying just now
        code = worker.process.exitcode
        if code is None:
            return f"no result after {self._timeout_s:g} s"
        if code < 0:
            return f"the process that worked on it was ended by {signal.Signals(-code).name}"
        return f"the process that worked on it ended with status {code}"


def _ready(busy: list[_Worker]) -> list[_Worker]:
    """Workers with an answer, dead ones, and those whose time is over."""
    heard = wait([worker.pipe for worker in busy], timeout=_LOOK_S)
    now = time.monotonic()
    return [one for one in busy if one.pipe in heard or now > one.until]


def _end(worker: _Worker) -> None:
    worker.pipe.close()
    if worker.process.is_alive():
        worker.process.kill()
    worker.process.join(timeout=5.0)


def _serve(
    pipe: Connection,
    work: Callable[[list[Any]], Sequence[Any]],
    environment: Mapping[str, str],
) -> None:
    """A worker's life: batches in, results out, until the pipe is closed."""
    # Both may go to the whole group; ending in order is the parent's to decide, and what it is
    # doing when it is told shall not look like a fault of the valve.
    begin_child(ignore=(signal.SIGINT, signal.SIGTERM))
    take_environment(environment)
    one_thread()
    logs_as_parent("worker")
    while True:
        try:
            batch = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            answer = (list(work(batch)), "")
        except Exception as error:
            answer = ([], f"{type(error).__name__}: {error}"[:500])
        try:
            pipe.send(answer)
        except OSError:
            return
