"""``QueueWorker``: processes the runs of the queue, one at a time.

All state is in the store: after a crash at any moment the next process continues from the queue.
"""

from __future__ import annotations

import logging
import os
import shutil
import threading
from collections import Counter
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path

from stemwatch.connectors.connector import Window
from stemwatch.models.words import counted
from stemwatch.service.config import Plant
from stemwatch.service.config.in_force import limits_in_force
from stemwatch.service.executors import Executor, ExecutorUnavailable, choose_executor
from stemwatch.service.process_lifecycle import process_name
from stemwatch.service.run.engine import continue_queued
from stemwatch.service.run.execute import Run
from stemwatch.service.run.finish import finish
from stemwatch.service.run.plan import Request
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.runs.queue import SILENT_AFTER
from stemwatch.service.store.screenings.records import RunState, StoredRun, ValveState
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)

HEARTBEAT_S = SILENT_AFTER.total_seconds() / 6
UNKNOWN = "the plant file does not describe this valve (any more)"
_LOOK_S = 5.0  # between checks for runs that another process queued
_RETRY_S = 5.0  # while the database is not available
_MOST_TRIALS = 12  # of a run that does not get on, before it fails
_PREFIX = "run-"


class QueueWorker:
    """Processes the queue in ``store`` for ``plant``.

    A run is taken over where its worker has sent no heartbeat for ``silent_after`` or is known to
    have ended. When stopped in the middle of a run, or when its executor is temporarily
    unavailable, the worker releases the run; the next start or another service continues it.
    """

    def __init__(
        self,
        store: Store,
        plant: Plant,
        *,
        silent_after: timedelta = SILENT_AFTER,
        heartbeat_s: float = HEARTBEAT_S,
    ) -> None:
        self._store, self._plant = store, plant
        self._silent_after, self._heartbeat_s = silent_after, heartbeat_s
        self.owner = process_name()
        self._trials = Counter[tuple[int, int]]()  # by run and how many of its valves were done
        self._more = threading.Event()

    def wake(self) -> None:
        """Check the queue at once, since something was queued."""
        self._more.set()

    def work(self, stop: threading.Event) -> None:
        """Process runs until ``stop`` is set."""
        while not stop.is_set():
            try:
                worked = self.once(stop)
            except StoreError as error:
                log.error("the queue cannot be reached: %s", error)
                stop.wait(_RETRY_S)
                continue
            if not worked:
                self._more.wait(_LOOK_S)
                self._more.clear()

    def once(self, stop: threading.Event) -> bool:
        """Process the next run; false where there is none or its executor cannot work now."""
        stored = self._store.queue.claim(self.owner, silent_after=self._silent_after)
        if stored is None:
            return False
        progress = (
            f" ({counted(stored.done, 'valve is', 'valves are')} done)" if stored.done else ""
        )
        log.info("run %d begins%s", stored.id, progress, extra={"run": stored.id})
        halt = threading.Event()
        heart = _Heartbeat(self._store, stored.id, self.owner, halt, self._heartbeat_s)
        following = threading.Thread(target=_follow, args=(stop, halt), daemon=True)
        following.start()
        try:
            self._work_on(stored, halt, heart)
        except (StoreError, ExecutorUnavailable) as error:
            return self._put_back(stored, error)
        except Exception as error:
            log.exception("run %d failed", stored.id, extra={"run": stored.id})
            self._fail(stored, error)
        finally:
            heart.end()
            halt.set()
        return True

    def _work_on(self, stored: StoredRun, halt: threading.Event, heart: _Heartbeat) -> None:
        limits = limits_in_force(self._plant, self._store.browser_settings.limits())
        plant = replace(self._plant, limits=limits)
        run = Run(
            store=self._store,
            number=stored.id,
            started=stored.started,
            executor=self._executor(),
            out=self._plant.beside(self._plant.service.reports) / f"{_PREFIX}{stored.id:06d}",
            plant=plant,
            limits=plant.limits,
            command=f"run {stored.id}" + (f" of {stored.schedule}" if stored.schedule else ""),
            zone=self._plant.zone or "UTC",
            queued=True,
            shown=self._plant.service.report_valves,
            networks=self._plant.service.networks,
        )

        def on_valve_done(valve: str, given_up: str) -> None:
            """Only after all is saved: a valve that was interrupted earlier is simply screened
            again."""
            state = ValveState.SET_ASIDE if given_up else ValveState.DONE
            if given_up:
                log_fields = {"run": stored.id, "valve": valve}
                text = "run %d: %s is set aside: %s"
                log.warning(text, stored.id, valve, given_up, extra=log_fields)
            self._store.queue.mark(stored.id, valve, state, given_up)

        executed, not_read = continue_queued(run, self._pending(stored, plant), halt, on_valve_done)
        if halt.is_set():
            self._stopped(stored, heart)
            return
        files = finish(run, executed, not_read).files
        _remove_old(run.out.parent, self._plant.service.keep_reports)
        report = None if files is None else str(run.out)
        finished = self._store.queue.finish(stored.id, RunState.DONE, report=report)
        text = "run %d is over: %s, %d set aside"
        valves = counted(finished.total, "valve")
        log.info(text, stored.id, valves, finished.set_aside, extra={"run": stored.id})

    def _executor(self) -> Executor:
        """The executor of ``[service]``; isolated, since work in this process could end the
        service."""
        service = self._plant.service
        workers = service.workers or max(1, (os.cpu_count() or 2) - 1)
        timeout_s = service.valve_timeout_s
        return choose_executor(workers, service.executor, item_timeout_s=timeout_s, isolated=True)

    def _pending(self, stored: StoredRun, plant: Plant) -> Request:
        """The pending valves of the run as a request; the same in every process.

        A run without a window reads whole files, and samples in the store as far back as
        ``[service] window_s`` says.
        """
        store = self._store
        store.save_valves(plant.valves.values())
        pending = store.queue.plan(stored.id, self._valves(stored), plant.settings_digest)
        for valve in pending:
            if valve not in plant.valves:
                store.queue.mark(stored.id, valve, ValveState.SET_ASIDE, UNKNOWN)
        start, stop = stored.window
        until = stop or stored.started
        since = start or until - timedelta(seconds=plant.service.window_s)
        return Request(
            plant=plant,
            valves=tuple(valve for valve in pending if valve in plant.valves),
            window=Window() if start is None else Window(start=start, stop=stop),
            live_window=Window(start=since, stop=until),
        )

    def _valves(self, stored: StoredRun) -> list[str]:
        """The valves of the run: the requested ones, else its schedule's, else all."""
        if stored.asked:
            return list(stored.asked)
        known_valves = {
            schedule.schedule.name: schedule.schedule for schedule in self._store.schedules.all()
        }
        schedule = known_valves.get(stored.schedule or "")
        valves = self._plant.valves.values()
        return [valve.id for valve in valves if schedule is None or schedule.takes(valve)]

    def _stopped(self, stored: StoredRun, heart: _Heartbeat) -> None:
        """Finish a cancelled run; release any other for a later start or another process."""
        if heart.cancelled_by:
            now = self._store.run(stored.id)
            reason = f"cancelled by {heart.cancelled_by} after {now.done} of {now.total} valves"
            self._store.queue.finish(stored.id, RunState.CANCELLED, reason=reason)
            log.info("run %d: %s", stored.id, reason, extra={"run": stored.id})
            return
        cause = "another process has taken it" if heart.taken_over else "the service stops"
        log.info("run %d is left for later (%s)", stored.id, cause, extra={"run": stored.id})
        if not heart.taken_over:
            self._store.queue.leave(stored.id, self.owner)

    def _put_back(self, stored: StoredRun, error: Exception) -> bool:
        """Release a run that its executor or the database kept from getting on, to retry it; after
        some trials it fails, since it would hold up all others.

        Raises ``StoreError`` while the database is not available, which is no trial.
        """
        trial = stored.id, stored.done
        if self._trials[trial] + 1 >= _MOST_TRIALS:
            self._fail(stored, error)
            return True
        self._store.queue.leave(stored.id, self.owner)
        self._trials[trial] += 1
        text = "run %d is tried again: %s"
        log.warning(text, stored.id, error, extra={"run": stored.id})
        return False

    def _fail(self, stored: StoredRun, error: Exception) -> None:
        reason = f"{type(error).__name__}: {error}"
        self._store.queue.finish(stored.id, RunState.FAILED, reason=reason)


@dataclass
class _Heartbeat:
    """Updates the heartbeat of a run every few seconds, and sets ``stop`` when the run was
    cancelled or taken over by another process."""

    store: Store
    run_id: int
    owner: str
    stop: threading.Event
    every_s: float = HEARTBEAT_S
    cancelled_by: str = ""
    taken_over: bool = False

    def __post_init__(self) -> None:
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._beat, name=f"run {self.run_id}", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Stop the heartbeat and wait for its thread to end."""
        self._over.set()
        self._thread.join()

    def _beat(self) -> None:
        while not self._over.wait(self.every_s):
            try:
                run = self.store.queue.beat(self.run_id, self.owner)
            except StoreError as error:
                log_fields = {"run": self.run_id}
                text = "run %d: the heartbeat could not be updated: %s"
                log.warning(text, self.run_id, error, extra=log_fields)
                continue
            if run is not None and run.cancel_asked_by is None:
                continue
            self.taken_over = run is None
            self.cancelled_by = (run.cancel_asked_by or "") if run else ""
            self.stop.set()
            return


def _follow(stop: threading.Event, halt: threading.Event) -> None:
    """Set ``halt``, which ends the run, when the service's ``stop`` is set."""
    while not halt.wait(0.2):
        if stop.is_set():
            halt.set()


def _remove_old(parent: Path, keep: int) -> None:
    """Remove all but the newest ``keep`` report folders; nothing else in ``parent`` is touched."""

    def number(path: Path) -> str:
        return path.name.removeprefix(_PREFIX)

    folders = [path for path in parent.glob(f"{_PREFIX}*") if path.is_dir()]
    reports = [path for path in folders if number(path).isdecimal()]
    for path in sorted(reports, key=lambda path: int(number(path)))[:-keep]:
        shutil.rmtree(path, ignore_errors=True)
