"""``Runner``: takes runs from the queue and works on them, one at a time, until it is stopped."""

from __future__ import annotations

import logging
import os
import socket
import threading
import uuid
from datetime import timedelta

from stemwatch.service.config import Plant
from stemwatch.service.scheduler.cluster_pool import ClusterPool
from stemwatch.service.scheduler.finish import finish
from stemwatch.service.scheduler.run import BEAT_S, Heart, ValveRun, ended
from stemwatch.service.scheduler.workers import WorkerPool
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.runs.queue import SILENT_AFTER
from stemwatch.service.store.screenings.records import RunState, StoredRun
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)

_LOOK_S = 5.0  # for runs that another process queued
_AWAY_S = 5.0


class Runner:
    """Works on the queue in ``store`` for ``plant``.

    A run whose worker has been silent for ``silent_after`` is taken over. Stopped in the middle of
    a run, it lets the run lie: the next start, or another service, goes on with it.
    """

    def __init__(
        self,
        store: Store,
        plant: Plant,
        *,
        silent_after: timedelta = SILENT_AFTER,
        beat_s: float = BEAT_S,
    ) -> None:
        self._store, self._plant = store, plant
        self._silent_after, self._beat_s = silent_after, beat_s
        self.owner = f"{socket.gethostname()}:{os.getpid()}:{uuid.uuid4().hex[:8]}"
        self._workers = plant.service.workers or max(1, (os.cpu_count() or 2) - 1)
        self._more = threading.Event()

    def wake(self) -> None:
        """Something was queued: look at once."""
        self._more.set()

    def work(self, stop: threading.Event) -> None:
        """Work until ``stop`` is set."""
        while not stop.is_set():
            try:
                worked = self.once(stop)
            except StoreError as error:
                log.error("the queue cannot be reached: %s", error)
                stop.wait(_AWAY_S)
                continue
            if not worked:
                self._more.wait(_LOOK_S)
                self._more.clear()

    def once(self, stop: threading.Event) -> bool:
        """Work on the next run, if there is one; whether there was."""
        run = self._store.queue.claim(self.owner, silent_after=self._silent_after)
        if run is None:
            return False
        done = f" ({run.done} valves are done)" if run.done else ""
        log.info("run %d begins%s", run.id, done, extra={"run": run.id})
        halt = threading.Event()
        heart = Heart(self._store, run.id, self.owner, halt, self._beat_s)
        following = threading.Thread(target=_follow, args=(stop, halt), daemon=True)
        following.start()
        try:
            self._work_on(run, halt, heart)
        except StoreError:
            raise  # the store is away: the run lies until it is back
        except Exception as error:
            log.exception("run %d failed", run.id, extra={"run": run.id})
            reason = f"{type(error).__name__}: {error}"
            self._store.queue.finish(run.id, RunState.FAILED, reason=reason)
        finally:
            heart.rest()
            halt.set()
        return True

    def _work_on(self, run: StoredRun, halt: threading.Event, heart: Heart) -> None:
        pool, workers = self._pool()
        valves = ValveRun(run, self._plant, self._store)
        valves.screen(pool, workers, halt)
        report = None
        if not halt.is_set():
            report = finish(valves, pool, halt)
        if halt.is_set():
            self._stopped(run, heart)
            return
        done = self._store.queue.finish(run.id, RunState.DONE, report=report)
        text = "run %d is over: %d valves, %d set aside"
        log.info(text, run.id, done.total, done.set_aside, extra={"run": run.id})

    def _pool(self) -> tuple[WorkerPool, int]:
        """Where ``[service] executor`` says, and how many work there."""
        service = self._plant.service
        if service.executor == "local":
            return WorkerPool(self._workers, service.valve_timeout_s), self._workers
        pool = ClusterPool(service.executor)
        return pool, pool.workers

    def _stopped(self, run: StoredRun, heart: Heart) -> None:
        how = ended(self._store.run(run.id), heart.why)
        if how is None:
            why = heart.why or "the service stops"
            log.info("run %d is left for later (%s)", run.id, why, extra={"run": run.id})
            if not heart.why:
                self._store.queue.leave(run.id, self.owner)
            return
        self._store.queue.finish(run.id, how[0], reason=how[1])
        log.info("run %d: %s", run.id, how[1], extra={"run": run.id})


def _follow(stop: threading.Event, halt: threading.Event) -> None:
    """``halt`` a run when the service stops."""
    while not halt.wait(0.2):
        if stop.is_set():
            halt.set()
