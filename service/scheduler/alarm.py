"""``Alarm``: APScheduler, which wakes the planner at the instants of the schedules.

Its jobs are made anew from the store's schedules at each start and whenever one changes, so that a
changed plant file leaves no old job behind; which instants are accounted for is the store's to
know. A job only queues, which takes milliseconds.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from datetime import UTC

from apscheduler.events import EVENT_JOB_ERROR, JobExecutionEvent
from apscheduler.schedulers.background import BackgroundScheduler

from stemwatch.service.scheduler.planner import Planner
from stemwatch.service.scheduler.triggers import ScheduleTrigger
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.runs.schedule import ScreeningSchedule
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)

LOOK_AGAIN_S = 20.0  # for schedules that were changed, and for what a failed job left behind
_REFRESH = "refresh"


class Alarm:
    """Wakes ``planner`` for the schedules in ``store``; ``queued`` is called after it was woken."""

    def __init__(
        self,
        store: Store,
        planner: Planner,
        zone: str,
        queued: Callable[[], None] = lambda: None,
        *,
        look_again_s: float = LOOK_AGAIN_S,
    ) -> None:
        self._store, self._planner, self._zone, self._queued = store, planner, zone, queued
        self._look_again_s = look_again_s
        self._known: dict[str, ScreeningSchedule] = {}
        self._looked_s: float | None = None
        self._scheduler = BackgroundScheduler(
            timezone=UTC,
            job_defaults={"coalesce": True, "max_instances": 1, "misfire_grace_time": None},
        )
        self._scheduler.add_listener(_say_error, EVENT_JOB_ERROR)

    def start(self) -> None:
        """Make up for what was missed, and wake from now on."""
        self._scheduler.add_job(
            self.look, "interval", seconds=self._look_again_s, id=_REFRESH, name=_REFRESH
        )
        self._scheduler.start()
        try:
            self.look()
        except StoreError as error:
            log.warning("the schedules cannot be read yet: %s", error)

    def stop(self) -> None:
        """Wake no more. What is queued stays queued."""
        self._scheduler.pause()  # else it hands out jobs while it waits for others
        self._scheduler.shutdown(wait=True)

    @property
    def silent_s(self) -> float | None:
        """Seconds since the schedules were last looked at without an error, ``None`` before the
        first time; three times ``look_again_s`` is a fault."""
        looked_s = self._looked_s
        return None if looked_s is None else time.monotonic() - looked_s

    def look(self) -> None:
        """Take over changed schedules, and queue whatever is due."""
        wanted = {
            kept.schedule.name: kept.schedule
            for kept in self._store.schedules.all()
            if kept.schedule.enabled
        }
        for name in self._known.keys() - wanted.keys():
            self._scheduler.remove_job(f"schedule:{name}")
        for name, schedule in wanted.items():
            if self._known.get(name) != schedule:
                self._scheduler.add_job(
                    self._wake,
                    ScheduleTrigger(schedule, self._zone),
                    id=f"schedule:{name}",
                    name=name,
                    replace_existing=True,
                )
        self._known = wanted
        self._wake()
        self._looked_s = time.monotonic()

    def _wake(self) -> None:
        if self._planner.plan():
            self._queued()


def _say_error(event: JobExecutionEvent) -> None:
    log.error("the schedules could not be looked at: %s", event.exception)
