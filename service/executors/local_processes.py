"""``LocalProcesses``: worker processes on this machine; a hang or crash of one is contained."""

from __future__ import annotations

import contextlib
import logging
import math
import pickle
import signal
import time
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from threading import Event
from typing import Any, Generic

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
from stemwatch.service.executors.in_process import InProcess
from stemwatch.service.logs import logs_as_parent
from stemwatch.service.process_lifecycle import (
    begin_child,
    environment,
    starting_quietly,
    take_environment,
    worker_context,
)

log = logging.getLogger(__name__)

_START_S = 120.0  # for a new process to report that it is ready
_FIRST_S = 60.0  # in addition for its first batch, which may import and compile
_POLL_S = 0.5
_MOST_STARTS = 5  # processes in a row that end before they are ready
_RETRY_S = 0.3


@dataclass(frozen=True)
class LocalProcesses:
    """``workers`` processes on this machine, each with one numerical thread.

    A worker that dies (killed, out of memory, a crash in a library), or takes more than
    ``item_timeout_s`` for each item of its batch, is replaced. A single batch is done in this
    process, to save the start of a worker, unless ``isolated``.
    """

    workers: int
    item_timeout_s: float = math.inf
    isolated: bool = False

    def hand_out(
        self, work: Work[Item, Result], batches: Batches[Item], stop: Event, *, alone: bool = False
    ) -> Generator[Answer[Result]]:
        """An answer for each batch, in the order in which they are done."""
        waiting = iter(batches)
        if not (self.isolated or alone):
            begin = list(islice(waiting, 2))
            if len(begin) < 2:
                yield from InProcess().hand_out(work, begin, stop)
                return
            waiting = chain(begin, waiting)
        pool = _Pool(work, self.workers, self.item_timeout_s)
        try:
            yield from pool.answers(waiting, stop)
        finally:
            pool.end()


@dataclass
class _Worker:
    process: BaseProcess
    pipe: Connection
    until: float  # deadline on the clock of time.monotonic()
    batch_index: int = 0
    batch: Sequence[Any] = ()
    ready: bool = False  # it has reported that it is
    fresh: bool = True  # it has had no batch yet


class _Pool(Generic[Item, Result]):
    """Processes that do ``work``, started as they are needed."""

    def __init__(
        self,
        work: Callable[[Sequence[Item]], Sequence[Result]],
        count: int,
        item_timeout_s: float,
    ) -> None:
        self._work, self._count, self._timeout_s = work, count, item_timeout_s
        self._context = worker_context()
        self._idle: list[_Worker] = []
        self._busy: list[_Worker] = []
        self._failed_starts = 0

    def answers(self, batches: Iterable[Sequence[Item]], stop: Event) -> Generator[Answer[Result]]:
        """An answer for each batch, until ``stop``."""
        numbered = enumerate(batches)
        answers: list[Answer[Result]] = []
        while not stop.is_set():
            # Workers get new batches before the caller spends time on saving the answers.
            for index, batch in islice(numbered, self._count - len(self._busy)):
                self._assign(index, batch)
            yield from answers
            if not self._busy:
                return
            heard = [self._receive(worker) for worker in self._ready()]
            answers = [answer for answer in heard if answer is not None]

    def end(self) -> None:
        """End every process, whatever it is doing."""
        for worker in (*self._idle, *self._busy):
            _end(worker)

    def _assign(self, index: int, batch: Sequence[Item]) -> None:
        worker = self._idle.pop() if self._idle else self._start()
        worker.batch_index, worker.batch = index, batch
        self._busy.append(worker)
        if worker.ready:
            self._send(worker)

    def _start(self) -> _Worker:
        """A new process; retried, since the server that it is forked from may have to restart."""
        for trial in range(_MOST_STARTS):
            our_end, theirs = self._context.Pipe()
            process = self._context.Process(
                target=_serve, args=(theirs, self._work, environment()), daemon=True
            )
            try:
                with starting_quietly():
                    process.start()
            except (EOFError, OSError) as error:
                our_end.close()
                log.warning("a worker process could not be started: %r", error)
                time.sleep(_RETRY_S * (trial + 1))
                continue
            finally:
                theirs.close()
            return _Worker(process, our_end, until=time.monotonic() + _START_S)
        raise ExecutorUnavailable(
            f"no worker process could be started in {_MOST_STARTS} trials; look for a limit on "
            "processes, memory or open files (`ulimit -a`), or use fewer --workers"
        )

    def _send(self, worker: _Worker) -> None:
        """Send a waiting worker its batch."""
        first_s = _FIRST_S if worker.fresh else 0.0
        worker.until = time.monotonic() + first_s + self._timeout_s * len(worker.batch)
        worker.fresh = False
        with contextlib.suppress(OSError):  # a dead worker is noticed when its answer is read
            worker.pipe.send(list(worker.batch))

    def _ready(self) -> list[_Worker]:
        """Workers that have answered, have died or are past their deadline."""
        heard = wait([worker.pipe for worker in self._busy], timeout=_POLL_S)
        now = time.monotonic()
        return [worker for worker in self._busy if worker.pipe in heard or now > worker.until]

    def _receive(self, worker: _Worker) -> Answer[Result] | None:
        """The worker's answer for its batch; ``None`` where it only reported that it is ready."""
        try:
            message = worker.pipe.recv() if worker.pipe.poll() else None
        except (EOFError, OSError):
            message = None
        except Exception as error:  # an answer that cannot be unpickled is a failure of its batch
            message = (), failure_of(error)
        if message is not None and not worker.ready:
            worker.ready, self._failed_starts = True, 0
            self._send(worker)
            return None
        self._busy.remove(worker)
        if message is not None:
            self._idle.append(worker)
            results, failure = message
            return Answer(index=worker.batch_index, results=results, failure=failure)
        failure = self._failure_of(worker)
        _end(worker)
        if worker.ready:
            return Answer(index=worker.batch_index, failure=failure)
        self._failed_starts += 1
        if self._failed_starts >= _MOST_STARTS:
            raise ExecutorUnavailable(
                f"{self._failed_starts} worker processes in a row ended before they could begin "
                f"({failure.reason}); look for a limit on memory or processes"
            )
        self._assign(worker.batch_index, worker.batch)
        return None

    def _failure_of(self, worker: _Worker) -> Failure:
        worker.process.join(timeout=0.2)  # it may be about to end
        code = worker.process.exitcode
        if code is None:
            return Failure(reason=f"no result after {self._timeout_s:g} s")
        if code < 0:
            reason = f"the process that worked on it was ended by {signal.Signals(-code).name}"
        else:
            reason = f"the process that worked on it ended with status {code}"
        return Failure(reason=reason, lost=True)


def _end(worker: _Worker) -> None:
    worker.pipe.close()
    if worker.process.is_alive():
        worker.process.kill()
    worker.process.join(timeout=5.0)


def _serve(
    pipe: Connection,
    work: Callable[[Sequence[Any]], Sequence[Any]],
    environment: Mapping[str, str],
) -> None:
    """The main function of a worker: receives batches, sends results, ends with the pipe."""
    # Both signals may go to the whole process group. The parent ends its workers in order; a worker
    # that died of the signal would look like a fault of the valve.
    begin_child(ignore=(signal.SIGINT, signal.SIGTERM))
    take_environment(environment)
    one_thread()
    logs_as_parent("worker")
    with contextlib.suppress(EOFError, OSError):  # the parent has closed the pipe
        pipe.send(True)
        while True:
            batch = pipe.recv()
            answer: tuple[Sequence[Any], Failure | None]
            try:
                answer = list(work(batch)), None
            except Exception as error:
                answer = (), _picklable(failure_of(error))
            try:
                pipe.send(answer)
            except OSError:
                raise
            except Exception as error:  # results that cannot be pickled
                pipe.send(((), _picklable(failure_of(error))))


def _picklable(failure: Failure) -> Failure:
    """The failure, without its exception where that cannot be pickled."""
    try:
        pickle.loads(pickle.dumps(failure.error))
    except Exception:
        return Failure(reason=failure.reason)
    return failure
