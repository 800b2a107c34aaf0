"""From a row of ``runs`` to a plain value."""

from __future__ import annotations

from stemwatch.models.verdict import Verdict
from stemwatch.service.store.records import RunState, StoredRun
from stemwatch.service.store.tables import RunRow


def stored_run(run: RunRow) -> StoredRun:
    """The row as a plain value."""
    return StoredRun(
        id=run.id,
        started=run.started,
        finished=run.finished,
        command=run.command,
        software_version=run.software_version,
        settings_digest=run.settings_digest,
        counts={Verdict(verdict): count for verdict, count in run.counts.items()},
        state=RunState(run.state),
        schedule=run.schedule,
        due=run.due,
        window=(run.window_start, run.window_stop),
        asked=tuple(run.asked or ()),
        who=run.who,
        total=run.total,
        done=run.done,
        set_aside=run.set_aside,
        heartbeat=run.heartbeat,
        cancel_asked_by=run.cancel_asked_by,
        reason=run.reason,
        report=run.report,
    )
