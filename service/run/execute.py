"""Tasks to results: screened in any executor, saved one by one, kept in a temporary file."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path

from stemwatch.models.limits import Limits
from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.service.config import Plant
from stemwatch.service.executors import Executor, Outcome, outcomes
from stemwatch.service.presenter.cost_of_sticking import RankBy
from stemwatch.service.report.charts.suspicion_pictures import ShownSuspicion
from stemwatch.service.report.charts.valve_plots import ValvePlots, plots_instead_of_samples
from stemwatch.service.report.charts.window_pictures import pack_pictures
from stemwatch.service.report.html_page import MOST_PLOTTED
from stemwatch.service.run.batches import make_batches
from stemwatch.service.run.clearest_suspicion import of_earlier_window
from stemwatch.service.run.outside_window import OutsideWindow
from stemwatch.service.run.saving import PlacedScreening, Saving, with_stored_context
from stemwatch.service.run.spill import ResultSpill
from stemwatch.service.run.task import Task, given_up, screen_packed
from stemwatch.service.store.store import Store

ScreenedTask = Outcome[Task, tuple[Screening, ValvePlots]]
OnScreened = Callable[[Screening, int, int], None]  # (screening, how many are done, of how many)
OnValveDone = Callable[[str, str], None]  # (valve, why it was given up; empty where it was not)


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run with its number in the store, its executor and its settings.

    ``queued``: it comes from the queue of the service, so it pauses while the database is not
    available, raises alerts and sends messages. ``shown`` is how many valves, the worst, the report
    shows; ``None`` shows all.
    """

    store: Store
    number: int
    started: datetime
    executor: Executor
    out: Path
    plant: Plant | None = None
    limits: Limits = field(default_factory=Limits)
    command: str = ""
    zone: str = "UTC"
    new_baseline: bool = False  # make this window each valve's baseline, whatever there was
    queued: bool = False
    shown: int | None = None
    networks: bool = True  # train the valves' networks
    rank_by: RankBy = RankBy.VERDICT  # the order of its report

    @property
    def queue_number(self) -> int | None:
        """The number of a run from the queue of the service; ``None`` of the command line's."""
        return self.number if self.queued else None


@dataclass(frozen=True, kw_only=True)
class Executed:
    """The results of the tasks in their order, without samples (valves that may need work keep an
    excerpt); ``previous`` is each valve's result in the window before; ``earlier_suspicions`` are
    of valves that are suspected to stick from earlier windows; ``outside_window`` is what was left
    out, with a sentence that says so."""

    results: ResultSpill
    previous: dict[str, PreviousFinding | None]
    earlier_suspicions: dict[str, ShownSuspicion] = field(default_factory=dict)
    not_saved: Sequence[tuple[str, str]] = ()
    outside_window: OutsideWindow = field(
        default_factory=lambda: OutsideWindow((), must_appear=False)
    )


def execute(
    run: Run,
    tasks: Sequence[Task],
    stop: threading.Event,
    *,
    on_screened: OnScreened = lambda *_: None,
    on_valve_done: OnValveDone = lambda *_: None,
) -> Executed:
    """Screen the tasks; the results are in their order, whatever order they were done in.

    Each result is saved and its samples released as soon as it arrives, so that memory does not
    grow with the number of valves and an interrupted run loses only what was not done. A task whose
    worker hung or died gets a screening with that reason. Recordings outside the window are left
    out, but not of a queued run, each of whose valves gets a result. Ends early when ``stop`` is
    set.
    """
    tasks = with_stored_context(tasks, run.store, run.queue_number)
    # Twice as many as the page draws: the order is provisional until the run is over.
    results = ResultSpill(2 * MOST_PLOTTED, partial(_criticality_of, run.plant))
    saving = Saving(
        run.store,
        run.number,
        run.started,
        tasks,
        new_baseline=run.new_baseline,
        must_save=run.queued,
        on_valve_done=on_valve_done,
    )
    outside_window = OutsideWindow(tasks, must_appear=run.plant is not None)
    suspicions: dict[str, ShownSuspicion] = {}
    done = 0
    for finished in _screened(run, tasks, stop):
        arrived = []
        for outcome in finished:
            if _is_left_out(run, outcome, outside_window):
                saving.skip(outcome.index, outcome.item.tags.valve, results)
            else:
                arrived.append(_put(results, outcome))
                _note_suspicion(run, suspicions, outcome.item, arrived[-1].screening)
        saving.take(arrived, results)
        done += len(finished) - len(arrived)
        for result in arrived:
            done += 1
            on_screened(result.screening, done, len(tasks))
    return Executed(
        results=results,
        previous=saving.previous,
        earlier_suspicions=suspicions,
        not_saved=tuple(saving.not_saved),
        outside_window=outside_window,
    )


def _criticality_of(plant: Plant | None, valve: str) -> str:
    """As the plant states it; empty where it does not."""
    entry = None if plant is None else plant.valves.get(valve)
    return "" if entry is None else str(entry.criticality)


def _is_left_out(run: Run, outcome: ScreenedTask, outside_window: OutsideWindow) -> bool:
    """Whether a recording has no sample in the window; no valve of a queued run is left out."""
    if run.queued:
        return False
    screening = None if outcome.result is None else outcome.result[0]
    return outside_window.leaves_out(outcome.item.tags.valve, screening)


def add_unsaved(run: Run, executed: Executed, tasks: Sequence[Task], stop: threading.Event) -> None:
    """Screen tasks again whose results are in the store, to get their plots; nothing is saved."""
    first = len(executed.results)
    for finished in _screened(run, with_stored_context(tasks, run.store, run.queue_number), stop):
        for outcome in finished:
            result = _put(executed.results, outcome, first)
            previous = run.store.previous_finding(result.screening, run.started)
            executed.previous[result.screening.valve] = previous
            _note_suspicion(run, executed.earlier_suspicions, outcome.item, result.screening)


def _note_suspicion(
    run: Run, suspicions: dict[str, ShownSuspicion], task: Task, screening: Screening
) -> None:
    """Keep for the report what shows best that the valve may stick, where the windows before this
    one raise the suspicion."""
    told, start = screening.without_position, screening.window[0]
    answers, packed_pictures = task.earlier_answers, run.store.packed_pictures
    shown = of_earlier_window(told, start, answers, packed_pictures)
    if shown is not None:
        suspicions[screening.valve] = shown


def _screened(
    run: Run, tasks: Sequence[Task], stop: threading.Event
) -> Iterator[list[ScreenedTask]]:
    """The outcomes of the tasks as the executor's workers finish them, a batch at a time."""
    batches = make_batches(tasks, run.executor.workers)
    work = partial(screen_packed, run.limits, os.getcwd(), networks=run.networks)
    return outcomes(run.executor, work, batches, stop)


def _put(results: ResultSpill, outcome: ScreenedTask, first: int = 0) -> PlacedScreening:
    """Put the outcome of a task into ``results``, counted from ``first``; return what is saved in
    the store.
    """
    index = first + outcome.index
    if outcome.result is None:
        screening, plots = plots_instead_of_samples(given_up(outcome.item, outcome.reason))
    else:
        screening, plots = outcome.result
    results.add(index, screening, plots)
    return PlacedScreening(
        task_index=index,
        screening=screening,
        given_up=outcome.reason,
        packed_pictures=pack_pictures(plots.pictures),
    )
