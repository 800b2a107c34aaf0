"""``Scheduler``: queues a run for each instant at which a schedule is due."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from stemwatch.models.words import counted
from stemwatch.service import __version__
from stemwatch.service.scheduler.instants import Missed, due_between, jitter, next_due
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.runs.schedules import StoredSchedule
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)

LONGEST_PAUSE_S = 20.0  # at the latest, since schedules may change and the clock may be set
_SOON_S, _LONG_S = 0.05, 3600.0
# Clocks of machines that serve one database differ by less; an instant further ahead comes from a
# wrong clock.
_AHEAD = timedelta(minutes=15)


class Scheduler:
    """Queues runs for the schedules in ``store``, whose cron times are in ``zone``; calls
    ``queued`` after queueing.

    It sleeps until the next instant, at most ``longest_pause_s`` seconds. Several processes may do
    this at the same time, since the store accepts each instant of a schedule once. If instants were
    missed while no service was running, one run is queued, for the last of them.
    """

    def __init__(
        self,
        store: Store,
        zone: str,
        queued: Callable[[], None] = lambda: None,
        *,
        longest_pause_s: float = LONGEST_PAUSE_S,
    ) -> None:
        self._store, self._zone, self._queued = store, zone, queued
        self._look_again_s = longest_pause_s
        self._looked_s: float | None = None
        self._logged = ""
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Queue a run for missed instants, and from now on for each due instant."""
        sleep_s = self._turn()
        self._thread = threading.Thread(target=self._loop, args=(sleep_s,), name="scheduler")
        self._thread.start()

    def stop(self) -> None:
        """Stop queueing. Queued runs remain in the queue."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    @property
    def silent_s(self) -> float | None:
        """Seconds since the schedules were last evaluated without an error, ``None`` before the
        first time."""
        looked_s = self._looked_s
        return None if looked_s is None else time.monotonic() - looked_s

    def look(self, now: datetime | None = None) -> list[int]:
        """Queue the runs that are due and not queued yet; return their numbers. A schedule that
        cannot be planned raises its error once all others are."""
        now = now or datetime.now(UTC)
        queued: list[int] = []
        failed: Exception | None = None
        for stored in self._store.schedules.all():
            try:
                number = self._plan(stored, now)
            except StoreError:
                raise  # the database is not available, or soon will not be: all of it comes again
            except Exception as error:
                failed = error
                error.add_note(f"schedule {stored.schedule.name}")
                continue
            if number is not None:
                queued.append(number)
        if queued:
            self._queued()
        if failed is not None:
            raise failed
        self._looked_s = time.monotonic()
        return queued

    def _loop(self, sleep_s: float) -> None:
        while not self._over.wait(sleep_s):
            sleep_s = self._turn()

    def _turn(self) -> float:
        """Call ``look`` once; return the seconds until the next time. The same error is logged
        once, and the next turn tries again."""
        try:
            self.look()
            coming = [stored.next_due for stored in self._store.schedules.all()]
        except Exception as error:  # whatever the error, the thread must go on
            if str(error) != self._logged:
                expected = isinstance(error, StoreError)
                text = "the schedules could not be looked at: %s"
                log.error(text, error, exc_info=None if expected else error)
            self._logged = str(error)
            return self._look_again_s
        self._logged = ""
        now = datetime.now(UTC)
        until = [(instant - now).total_seconds() for instant in coming if instant is not None]
        return min(max(min(until, default=_LONG_S), _SOON_S), self._look_again_s)

    def _plan(self, stored: StoredSchedule, now: datetime) -> int | None:
        schedule = stored.schedule
        since = stored.last_due or stored.created
        if since > now + _AHEAD:
            self._begin_anew(schedule.name, since, now)
            since = now
        coming = next_due(schedule, now, self._zone) if schedule.enabled else None
        missed = due_between(schedule, since, now, self._zone)
        if not schedule.enabled:
            # Instants that pass while a schedule is disabled are not made up for later.
            self._store.schedules.note(schedule.name, now if missed else None, None)
            return None
        if missed is None:
            if coming != stored.next_due:
                self._store.schedules.note(schedule.name, None, coming)
            return None
        number = self._store.queue.put(
            self._run_to_queue(stored, missed), software_version=__version__
        )
        self._store.schedules.note(schedule.name, missed.last, coming)
        if number is not None:
            text = "run %d of schedule %s is queued for %s"
            log.info(text, number, schedule.name, missed.last, extra={"run": number})
        return number

    def _begin_anew(self, name: str, since: datetime, now: datetime) -> None:
        """Plan a schedule from ``now`` on; otherwise it would wait until the clock reaches
        ``since``."""
        log.warning(
            "schedule %s was looked at when the clock said %s; it has been set back, and the "
            "schedule goes on from %s",
            name,
            since.isoformat(timespec="seconds"),
            now.isoformat(timespec="seconds"),
        )
        self._store.queue.forget_instants_after(name, now)
        self._store.schedules.note(name, now, None)

    def _run_to_queue(self, stored: StoredSchedule, missed: Missed) -> RunToQueue:
        schedule, due = stored.schedule, missed.last
        start = None
        if schedule.window_s is not None:
            start = due - timedelta(seconds=schedule.window_s)
        reason = ""
        if missed.count > 1:
            at_least = "at least " if missed.at_least else ""
            instants = counted(missed.count - 1, "instant")
            them = "it" if missed.count == 2 else "them"
            reason = f"{at_least}{instants} before it had been missed; this run makes up for {them}"
        return RunToQueue(
            schedule=schedule.name,
            due=due,
            not_before=due + jitter(schedule, due),
            window=(start, due),
            reason=reason,
        )
