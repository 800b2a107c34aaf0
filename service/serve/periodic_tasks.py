"""The periodic tasks of the service: watched folders, silent sources, messages, old samples."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

from stemwatch.service.alerts.digest import queue_messages
from stemwatch.service.alerts.notifiers import notifiers_of
from stemwatch.service.alerts.sender import Sender
from stemwatch.service.alerts.silent_sources import watch_sources
from stemwatch.service.config import Plant
from stemwatch.service.serve.clock_watch import ClockWatch
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.store import Store
from stemwatch.service.watch import WatchedFolder

log = logging.getLogger(__name__)

FOLDERS_S, MESSAGES_S, SOURCES_S, OLD_S, LEASE_S = 3.0, 10.0, 15.0, 3600.0, 15.0
LEASE = "service"  # the lease that a running service holds on its store
LEASE_FOR = timedelta(seconds=60)

PeriodicTask = Callable[[], object]


def periodic_tasks(store: Store, plant: Plant, owner: str) -> list[tuple[str, float, PeriodicTask]]:
    """(name, interval in seconds, function) of each task."""
    sender = Sender(store, notifiers_of(plant))
    last_updates = [state.updated for state in store.sources.states()]
    clock = ClockWatch(max(last_updates, default=None))
    tasks: list[tuple[str, float, PeriodicTask]] = [
        ("lease", LEASE_S, lambda: store.leases.hold(LEASE, owner, LEASE_FOR)),
        ("messages", MESSAGES_S, sender.send_due),
        ("old samples", OLD_S, lambda: _old_samples(store, plant, clock)),
    ]
    if plant.devices:
        tasks.append(("sources", SOURCES_S, lambda: _sources(store, plant, clock)))
    for source in plant.sources.values():
        if source.folder is not None:
            folder = WatchedFolder(plant, source.name, store)
            tasks.append((f"folder {source.name}", FOLDERS_S, folder.look))
    return tasks


def repeat(name: str, every_s: float, task: PeriodicTask, stop: threading.Event) -> None:
    """Do ``task`` now and every ``every_s`` seconds until ``stop``. The same error is logged once,
    and once more when it is over."""
    failing = ""
    while True:
        try:
            task()
            if failing:
                log.info("%s: works again", name)
            failing = ""
        except Exception as error:  # the task is tried again, and the others must go on
            words = f"{type(error).__name__}: {error}"
            if words != failing:
                expected = isinstance(error, StoreError)
                log.error("%s: %s", name, words, exc_info=None if expected else error)
            failing = words
        if stop.wait(every_s):
            return


def remove_old(store: Store, plant: Plant) -> int:
    """Remove days of samples older than ``[service] keep_samples_days``; return how many."""
    oldest = datetime.now(UTC) - timedelta(days=plant.service.keep_samples_days)
    removed = store.samples.remove_before(oldest, whole_days=True)
    if removed:
        log.info("%d samples from before %s were removed", removed, oldest.date())
    return removed


def _old_samples(store: Store, plant: Plant, clock: ClockWatch) -> None:
    if clock.trusted():
        remove_old(store, plant)
    else:
        log.warning("no old samples are removed until the clock has gone evenly for a day")


def _sources(store: Store, plant: Plant, clock: ClockWatch) -> None:
    if watch_sources(store, plant, clock.even_since()):
        queue_messages(store, plant)
