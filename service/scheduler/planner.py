"""``Planner``: a run in the queue for each instant that a schedule is due."""

from __future__ import annotations

import logging
from datetime import UTC, datetime, timedelta

from stemwatch.service import __version__
from stemwatch.service.scheduler.triggers import Missed, due_between, jitter, next_due
from stemwatch.service.store.runs.queue import RunRequest
from stemwatch.service.store.runs.schedules import StoredSchedule
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)


class Planner:
    """Queues what is due, in ``zone``. Several processes may plan: the store takes each instant of
    a schedule once.

    What was missed while no service ran is made up for by one run, for the last instant missed.
    """

    def __init__(self, store: Store, zone: str) -> None:
        self._store, self._zone = store, zone

    def plan(self, now: datetime | None = None) -> list[int]:
        """Queue every schedule's run that is due and not queued; the numbers of the new runs."""
        now = now or datetime.now(UTC)
        queued: list[int] = []
        for kept in self._store.schedules.all():
            number = self._plan_one(kept, now)
            if number is not None:
                queued.append(number)
        return queued

    def _plan_one(self, kept: StoredSchedule, now: datetime) -> int | None:
        schedule = kept.schedule
        since = kept.last_due or kept.created
        coming = next_due(schedule, now, self._zone) if schedule.enabled else None
        missed = due_between(schedule, since, now, self._zone)
        if not schedule.enabled:
            # What passes while a schedule rests is no debt when it is woken.
            self._store.schedules.note(schedule.name, now if missed else None, None)
            return None
        if missed is None:
            if coming != kept.next_due:
                self._store.schedules.note(schedule.name, None, coming)
            return None
        number = self._store.queue.put(self._wanted(kept, missed), software_version=__version__)
        self._store.schedules.note(schedule.name, missed.last, coming)
        if number is not None:
            text = "run %d of schedule %s is queued for %s"
            log.info(text, number, schedule.name, missed.last, extra={"run": number})
        return number

    def _wanted(self, kept: StoredSchedule, missed: Missed) -> RunRequest:
        schedule, due = kept.schedule, missed.last
        start = None
        if schedule.window_s is not None:
            start = due - timedelta(seconds=schedule.window_s)
        reason = ""
        if missed.count > 1:
            many = f"{'at least ' if missed.at_least else ''}{missed.count - 1}"
            reason = f"{many} instants before it had been missed; this run makes up for them"
        return RunRequest(
            schedule=schedule.name,
            due=due,
            not_before=due + jitter(schedule, due),
            window=(start, due),
            reason=reason,
        )
