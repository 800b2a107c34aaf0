"""One engine for every run, on one page.

    request -> plan -> execute (in any executor) -> finish
               tasks   saved as they come           report, work list, alerts

The command line asks for a run here (``screen_now``); schedules, watched folders, pages and API ask
through the queue of the store (``QueueWorker``). Nothing here knows how a file is read or how a
valve is judged, and only results without samples and plots travel between processes.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.secret import masked_command
from stemwatch.models.limits import Limits
from stemwatch.models.screening_result import Residual, Screening
from stemwatch.service import __version__
from stemwatch.service.executors import Executor
from stemwatch.service.process_lifecycle import Terminated, process_name
from stemwatch.service.report import ReportFiles
from stemwatch.service.report.ranking import light
from stemwatch.service.run.execute import Executed, Over, Run, Told, add_unsaved, execute
from stemwatch.service.run.finish import NotRead, finish
from stemwatch.service.run.plan import Plan, Request, look_with, make_plan
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store

MOST_REASONS = 5  # of a run in which nothing could be read


@dataclass(frozen=True, kw_only=True)
class RunNow:
    """What a run of the command line needs beside its request."""

    store: Store
    executor: Executor
    out: Path
    limits: Limits = field(default_factory=Limits)
    command: tuple[str, ...] = ()
    new_baseline: bool = False  # make this window each valve's baseline, whatever there was


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """What came out, of at least one valve.

    ``screenings`` are those of the tasks in their order, without their samples (an excerpt is left
    of valves that need work); they are read from a disk when they are asked for. ``brief`` are the
    same in memory, with as much as a line of text needs.
    """

    screenings: Sequence[Screening]
    brief: tuple[Screening, ...]
    report: ReportFiles
    not_read: tuple[tuple[str, str], ...]
    not_saved: tuple[tuple[str, str], ...]


class NothingScreened(ConnectorError):
    """No source of a run could be read as it was asked for. The text has each reason once."""

    @classmethod
    def of(cls, screenings: Sequence[Screening], not_read: NotRead) -> NothingScreened:
        """The error of a run with these results, none of which saw a recording."""
        reasons = [screening.S.reason or screening.reason for screening in screenings]
        reasons += [f"{place}: {reason}" for place, reason in not_read]
        every = [reason.rstrip(".") for reason in dict.fromkeys(reasons)]
        more = len(every) - MOST_REASONS
        said = [*every[:MOST_REASONS], *([f"and {more} more reasons"] if more > 0 else [])]
        return cls(f"nothing could be screened: {'; '.join(said) or 'no valve was asked for'}.")


def screen_now(request: Request, how: RunNow, tell: Told = lambda *_: None) -> RunResult:
    """Screen everything a request names, as a run of its own.

    Where nothing could be read, ``NothingScreened`` is raised and an earlier report stays as it is.
    Raises ``UnreadableSource``, ``ExecutorUnavailable``, ``StoreError`` and ``ReportNotWritten``.
    """
    plant, started = request.plant, datetime.now(UTC)
    planned = make_plan(request)
    run = Run(
        store=how.store,
        number=how.store.begin_run(
            command=how.command,
            software_version=__version__,
            settings_digest=plant.settings_digest if plant else "",
            owner=process_name(),
        ),
        started=started,
        executor=how.executor,
        out=how.out,
        plant=plant,
        limits=how.limits,
        command=masked_command(how.command),
        zone=(plant.zone if plant else None) or request.read_options.zone or "UTC",
        new_baseline=how.new_baseline,
    )
    try:
        if plant is not None:
            how.store.save_valves(plant.valves.values())
        executed = execute(run, planned.tasks, threading.Event(), tell=tell)
        brief = tuple(in_brief(result) for result in executed.results)
        if not any(screening.was_read for screening in brief):
            raise NothingScreened.of(brief, planned.not_read)
        report = finish(run, executed, planned.not_read)
    except BaseException as error:
        _note_end(run, error)
        raise
    assert report is not None  # a run of the command line has one, or an error
    return RunResult(
        screenings=executed.results,
        brief=brief,
        report=report,
        not_read=planned.not_read,
        not_saved=tuple(executed.not_saved),
    )


def work_off(
    run: Run, request: Request, stop: threading.Event, over: Over
) -> tuple[Executed, NotRead]:
    """Do ``request``, which is what is left of a queued run of a plant, until ``stop``.

    What an earlier process did of it and the report shows is then screened again without being
    saved: its samples are gone.
    """
    look = look_with(run.executor, stop)
    planned = make_plan(request, look) if request.valves else Plan(tasks=())
    executed = execute(run, planned.tasks, stop, over=over)
    shown = run.store.worst_of_run(run.number, run.shown or 0)
    known = run.plant.valves if run.plant else {}
    gone = tuple(valve for valve in shown if valve not in executed.previous and valve in known)
    if gone and not stop.is_set():
        again = make_plan(replace(request, valves=gone), look)
        add_unsaved(run, executed, again.tasks, stop)
    return executed, planned.not_read


def in_brief(screening: Screening) -> Screening:
    """As much of a result as its rank and a line of text need: some KB."""
    nothing: dict[str, Residual | None] = {}
    return replace(light(screening), residuals=nothing, network=None)


def _note_end(run: Run, error: BaseException) -> None:
    """A run of the command line that an error or Ctrl-C ends is not left as one that goes on.

    One whose process is killed is found by whoever uses the store next (``end_lost``).
    """
    by_hand = isinstance(error, KeyboardInterrupt)
    state = RunState.CANCELLED if by_hand else RunState.FAILED
    reason = f"{type(error).__name__}: {error}"
    if by_hand:
        terminated = isinstance(error, Terminated)
        reason = "ended by SIGTERM" if terminated else "interrupted by Ctrl-C"
    with suppress(StoreError):
        if run.store.run(run.number).finished is None:
            run.store.queue.finish(run.number, state, reason=reason)
