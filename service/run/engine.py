"""The engine of every run, on one page.

    request -> plan -> execute (in any executor) -> finish
               tasks   saved as they come           report, work list, alerts

The command line starts a run here (``screen_now``); schedules, pages and API put runs into the
queue of the store, which ``QueueWorker`` processes. Between processes travel only plots and results
without samples.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.secret import masked_command
from stemwatch.models.limits import Limits
from stemwatch.models.screening_result import Residual, Screening
from stemwatch.models.words import counted
from stemwatch.service import __version__
from stemwatch.service.executors import Executor
from stemwatch.service.interruption import (
    Terminated,
    interrupts_held,
    interrupts_let_through,
    is_interrupt,
)
from stemwatch.service.presenter.cost_of_sticking import RankBy
from stemwatch.service.process_lifecycle import process_name
from stemwatch.service.report import ReportContext, ReportFiles
from stemwatch.service.report.ranking import reduced_for_ranking
from stemwatch.service.run.execute import (
    Executed,
    OnScreened,
    OnValveDone,
    Run,
    add_unsaved,
    execute,
)
from stemwatch.service.run.finish import NotRead, finish
from stemwatch.service.run.plan import Plan, Request, make_plan, read_tags_with
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)

MOST_REASONS = 5  # of a run in which nothing could be read


@dataclass(frozen=True, kw_only=True)
class RunNow:
    """The settings of a run of the command line beside its request."""

    store: Store
    executor: Executor
    out: Path
    limits: Limits = field(default_factory=Limits)
    command: tuple[str, ...] = ()
    new_baseline: bool = False  # makes this window the baseline of each valve, replacing any other
    rank_by: RankBy = RankBy.VERDICT


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """The results of a run of the command line, of at least one valve that was read.

    ``screenings`` are in the order of the tasks and without samples (valves that need work keep an
    excerpt); they are read from a temporary file on access. ``brief`` holds the same screenings in
    memory, reduced to what a line of text needs.
    """

    screenings: Sequence[Screening]
    brief: tuple[Screening, ...]
    report: ReportFiles
    context: ReportContext  # what the report says beside the screenings
    not_read: tuple[tuple[str, str], ...]
    not_saved: tuple[tuple[str, str], ...]
    outside_window: str = ""  # how many recordings were left out for the window, one sentence


class NothingScreened(ConnectorError):
    """No source of a run could be read as requested. The text has each reason once."""

    @classmethod
    def of(cls, screenings: Sequence[Screening], not_read: NotRead) -> NothingScreened:
        """The error of a run none of whose sources could be read."""
        reasons = [screening.S.reason or screening.reason for screening in screenings]
        reasons += [f"{source}: {reason}" for source, reason in not_read]
        unique = [reason.rstrip(".") for reason in dict.fromkeys(reasons)]
        unlisted = len(unique) - MOST_REASONS
        reason_list = [
            *unique[:MOST_REASONS],
            *([f"and {counted(unlisted, 'more reason')}"] if unlisted > 0 else []),
        ]
        return cls(
            f"nothing could be screened: {'; '.join(reason_list) or 'no valve was asked for'}."
        )


def screen_now(
    request: Request, how_to_run: RunNow, on_screened: OnScreened = lambda *_: None
) -> RunResult:
    """Screen everything that a request names, as a run of its own.

    Raises ``NothingScreened`` where nothing could be read (an earlier report is then kept),
    ``UnreadableSource``, ``ExecutorUnavailable``, ``StoreError`` and ``ReportNotWritten``.
    """
    plant, started = request.plant, datetime.now(UTC)
    planned = make_plan(request)
    with interrupts_held():  # once the run is in the store, this function must record its end
        run = Run(
            store=how_to_run.store,
            number=how_to_run.store.begin_run(
                command=how_to_run.command,
                software_version=__version__,
                settings_digest=plant.settings_digest if plant else "",
                owner=process_name(),
            ),
            started=started,
            executor=how_to_run.executor,
            out=how_to_run.out,
            plant=plant,
            limits=how_to_run.limits,
            command=masked_command(how_to_run.command),
            zone=request.zone,
            new_baseline=how_to_run.new_baseline,
            rank_by=how_to_run.rank_by,
        )
        try:
            with interrupts_let_through():
                return _screen_planned(run, planned, on_screened)
        except BaseException as error:
            _note_end(run, error)
            raise


def _screen_planned(run: Run, planned: Plan, on_screened: OnScreened) -> RunResult:
    """Execute and finish a run of the command line. Raises as ``screen_now`` does."""
    if run.plant is not None:
        run.store.save_valves(run.plant.valves.values())
    executed = execute(run, planned.tasks, threading.Event(), on_screened=on_screened)
    brief = tuple(in_brief(result) for result in executed.results)
    if not any(screening.was_read for screening in brief):
        nothing_read = (*brief, *executed.outside_window.screenings)
        raise NothingScreened.of(nothing_read, planned.not_read)
    finished = finish(run, executed, planned.not_read)
    report, context = finished.files, finished.context
    # A run of the command line writes a report or raises.
    assert report is not None
    assert context is not None
    return RunResult(
        screenings=executed.results,
        brief=brief,
        report=report,
        context=context,
        not_read=planned.not_read,
        not_saved=tuple(executed.not_saved),
        outside_window=executed.outside_window.sentence,
    )


def continue_queued(
    run: Run, request: Request, stop: threading.Event, on_valve_done: OnValveDone
) -> tuple[Executed, NotRead]:
    """Screen ``request``, the pending part of a queued run, until ``stop`` is set.

    Valves that the report shows but an earlier process screened are screened again without being
    saved, because their plots were lost with that process.
    """
    read_tags = read_tags_with(run.executor, stop)
    planned = make_plan(request, read_tags) if request.valves else Plan(tasks=())
    executed = execute(run, planned.tasks, stop, on_valve_done=on_valve_done)
    reported = run.store.worst_of_run(run.number, run.shown or 0)
    plant_valves = run.plant.valves if run.plant else {}
    without_plots = tuple(
        valve for valve in reported if valve not in executed.previous and valve in plant_valves
    )
    if without_plots and not stop.is_set():
        plan_of_plots = make_plan(replace(request, valves=without_plots), read_tags)
        add_unsaved(run, executed, plan_of_plots.tasks, stop)
    return executed, planned.not_read


def in_brief(screening: Screening) -> Screening:
    """The screening reduced to what its rank and a line of text need, some KB."""
    no_residuals: dict[str, Residual | None] = {}
    return replace(reduced_for_ranking(screening), residuals=no_residuals, network=None)


def _note_end(run: Run, error: BaseException) -> None:
    """Store that an error, Ctrl-C or SIGTERM ended the run, so that it does not remain as running.

    A run whose process was killed is ended by the next use of the store (``end_lost``).
    """
    interrupted = is_interrupt(error)
    state = RunState.CANCELLED if interrupted else RunState.FAILED
    reason = f"{type(error).__name__}: {error}"
    if interrupted:
        terminated = isinstance(error, Terminated) or isinstance(error.__cause__, Terminated)
        reason = "ended by SIGTERM" if terminated else "interrupted by Ctrl-C"
    try:
        if run.store.run(run.number).finished is None:
            run.store.queue.finish(run.number, state, reason=reason)
    except StoreError as refused:
        log.warning(
            "run %d is over (%s), which could not be stored: %s. The next run ends it",
            run.number,
            reason,
            refused,
        )
