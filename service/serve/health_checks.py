"""Health checks of the service's parts, for ``/healthz``, ``/ready`` and ``/metrics``.

The texts are public: they contain no address and no secret.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING

from stemwatch.service.config import Plant
from stemwatch.service.scheduler import Scheduler
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.store import Store

if TYPE_CHECKING:
    from stemwatch.service.web.site import Check

_OLD_STATE = timedelta(seconds=60)
_SCHEDULES_LATE_S = 60.0  # three times the scheduler's interval
_NOT_HEARD = "nothing is heard of it"
_FAULTY = "it does not answer as it should; the page of sources says why"


def health_checks(
    store: Store, plant: Plant, scheduler: Scheduler, working: Sequence[threading.Thread] = ()
) -> list[Check]:
    """The state of each part. ``vital`` parts are those without which the service does not work:
    the store, the scheduler, threads that must not end, the collector's process."""
    from stemwatch.service.web.site import Check

    checks = [_scheduler(scheduler)]
    checks += [
        Check(name=thread.name, ok=False, says="it has ended; the log says why", vital=True)
        for thread in working
        if not thread.is_alive()
    ]
    try:
        states = {state.source: state for state in store.sources.states()}
        going = store.queue.going()
    except StoreError:
        problem = "the database does not answer"
        return [*checks, Check(name="store", ok=False, says=problem, vital=True)]
    # The service renews its lease every few seconds, so this answer is never old.
    stuck = bool(store.transactions.write_fault)
    problem = "the database cannot be written; the log says why" if stuck else ""
    checks.append(Check(name="store", ok=not stuck, says=problem, vital=True))
    late = [run for run in going if run.heartbeat and _old(run.heartbeat)]
    to_do = f"{len(going)} {'run' if len(going) == 1 else 'runs'} to do"
    problem = f"run {late[0].id} has been silent for a while" if late else to_do
    checks.append(Check(name="runs", ok=not late, says=problem))
    if plant.devices:
        checks.append(_collector([states[name] for name in plant.devices if name in states]))
    for name in plant.devices:
        state = states.get(name)
        if state is None or _old(state.updated):
            checks.append(Check(name=f"device {name}", ok=False, says=_NOT_HEARD))
        else:
            problem = _FAULTY if state.fault else ""  # a fault may hold the device's address
            checks.append(Check(name=f"device {name}", ok=not problem, says=problem))
    return checks


def _scheduler(scheduler: Scheduler) -> Check:
    from stemwatch.service.web.site import Check

    silent_s = scheduler.silent_s
    if silent_s is None:
        problem = "the schedules were not looked at yet"
    elif silent_s > _SCHEDULES_LATE_S:
        problem = f"the schedules were looked at {silent_s:.0f} s ago"
    else:
        problem = ""
    return Check(name="scheduler", ok=not problem, says=problem, vital=True)


def _collector(states: Sequence[SourceState]) -> Check:
    """The collector reports on every device each few seconds, whether the device answers or not."""
    from stemwatch.service.web.site import Check

    reports = any(not _old(state.updated) for state in states)
    problem = "" if reports else "it has not reported on any device in the last minute"
    return Check(name="collector", ok=reports, says=problem, vital=True)


def _old(instant: datetime) -> bool:
    return abs(datetime.now(UTC) - instant) > _OLD_STATE  # ahead where the clock was set back
