"""``Finisher``: alerts, report and messages of a run whose valves are done. All of it may be done
again without doing anything twice."""

from __future__ import annotations

import logging
import shutil
import threading
from collections.abc import Sequence
from pathlib import Path

from stemwatch.models.screening_result import Screening
from stemwatch.service.alerts.digest import tell
from stemwatch.service.alerts.evaluate import evaluate
from stemwatch.service.alerts.held_back import hold_back, p_elsewhere
from stemwatch.service.maintenance.from_store import report_of_run
from stemwatch.service.report import write_report
from stemwatch.service.report.report_context import ReportContext, SourceNotRead
from stemwatch.service.run.engine import facts_of
from stemwatch.service.scheduler.run import ValveRun, missing_pictures
from stemwatch.service.scheduler.workers import WorkerPool
from stemwatch.service.store.screenings.false_discoveries import TestedScreening

log = logging.getLogger(__name__)

_PREFIX = "run-"


def finish(run: ValveRun, pool: WorkerPool, stop: threading.Event) -> str | None:
    """Raise alerts, write the report, queue the messages; the folder of the report.

    A report that cannot be written costs the report only.
    """
    tested = hold_back(run.store, run.run.id)
    evaluate(run.store, run.plant, run.run.id)
    folder: str | None = None
    try:
        folder = _report(run, pool, stop, tested)
    except OSError as error:
        text = "run %d: the report could not be written: %s"
        log.error(text, run.run.id, error, extra={"run": run.run.id})
    tell(run.store, run.plant, run_id=run.run.id)
    return folder


def report_folder(run: ValveRun) -> Path:
    """Where the report of a run lies."""
    return run.plant.beside(run.plant.service.reports) / f"{_PREFIX}{run.run.id:06d}"


def _report(
    run: ValveRun, pool: WorkerPool, stop: threading.Event, tested: Sequence[TestedScreening]
) -> str | None:
    limit = run.plant.service.report_valves
    wanted = run.store.worst_of_run(run.run.id, limit)
    have = {one.valve for one in run.worst.screenings}
    if run.run.done == 0:
        have.update(wanted)  # nothing was done before this process
    missing_pictures([valve for valve in wanted if valve not in have], run, pool, stop)
    screenings = run.worst.screenings
    if not screenings:
        return None
    folder = report_folder(run)
    elsewhere = p_elsewhere(tested, [one.valve for one in screenings])
    write_report(screenings, _context(run, len(wanted), elsewhere), folder)
    _maintenance(run, screenings, folder)
    _remove_old(folder.parent, run.plant.service.keep_reports)
    return str(folder)


def _maintenance(run: ValveRun, screenings: Sequence[Screening], folder: Path) -> None:
    """Pages and work orders of all valves of the run; without them it still has its report."""
    try:
        report_of_run(run.store, run.plant, run.run.id, screenings, folder)
    except Exception:  # the alerts and the run's own report are worth more
        text = "run %d: the maintenance report could not be written"
        log.exception(text, run.run.id, extra={"run": run.run.id})


def _context(run: ValveRun, shown: int, elsewhere: tuple[float | None, ...]) -> ReportContext:
    stored = run.store.run(run.run.id)
    notes = [
        SourceNotRead(source=valve, reason=reason)
        for valve, reason in run.store.queue.set_aside(run.run.id)
    ]
    more = stored.total - stored.set_aside - shown
    if more > 0:
        text = f"{more} valves less severe than these are in the ranking of the service only"
        notes.append(SourceNotRead(source="this report", reason=text))
    notes += [SourceNotRead(source=str(one.file), reason=str(one)) for one in run.plant.problems]
    return ReportContext(
        started=run.run.started,
        plant=run.plant.name,
        zone=run.plant.zone or "UTC",
        command=f"run {run.run.id}" + (f" of {run.run.schedule}" if run.run.schedule else ""),
        settings_digest=run.plant.settings_digest,
        valves={
            valve: facts_of(run.plant, valve, before) for valve, before in run.previous.items()
        },
        sources_not_read=tuple(notes),
        p_elsewhere=elsewhere,
    )


def _remove_old(parent: Path, keep: int) -> None:
    """Only folders that a run made are removed, whatever else lies there."""
    runs = sorted(
        path
        for path in parent.glob(f"{_PREFIX}*")
        if path.is_dir() and path.name.removeprefix(_PREFIX).isdigit()
    )
    for path in runs[:-keep]:
        shutil.rmtree(path, ignore_errors=True)
