"""Tasks to results: screened in any executor, kept on a disk, saved as they come."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TypeVar

from stemwatch.models.limits import Limits
from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.service.config import Plant
from stemwatch.service.executors import Executor, Outcome, outcomes
from stemwatch.service.report.charts.valve_plots import ValvePlots, plots_instead_of_samples
from stemwatch.service.report.html_page import MOST_PLOTTED
from stemwatch.service.run.saving import (
    PlacedScreening,
    Saving,
    with_what_was_found,
)
from stemwatch.service.run.spill import ResultSpill
from stemwatch.service.run.task import Task, given_up, screen_packed
from stemwatch.service.store.store import Store

PER_WORKER = 3  # shares of what is left for each worker

T = TypeVar("T")

# Valves that one worker takes at a time. Their networks train together, which is quicker; but every
# worker should have some, and progress should be seen.
CHUNK = 16
# So many valves take far longer to fit than a worker to start and a file of so many bytes to parse.
WORTH_PARTING, PARTED_UP_TO = 8, 32 * 2**20

Told = Callable[[Screening, int, int], None]  # a screening is there: it, how many done, of how many
Over = Callable[[str, str], None]  # all of a valve is saved: it, and why it was given up if it was


def make_chunks(
    items: Sequence[T],
    workers: int,
    most: int,
    parsed: Callable[[T], str | None] = lambda _: None,
) -> list[tuple[T, ...]]:
    """``items`` in order, dealt so that ``workers`` end at nearly the same time.

    Each share is a part of what is left, one in ``PER_WORKER`` times ``workers``, and ``most`` at
    most: guided self-scheduling (Polychronopoulos and Kuck, 1987). Equal shares would leave all but
    one worker idle while the last one is done. ``parsed`` names what has to be parsed as a whole
    for an item, if anything: neighbours of one name go to one worker where ``most`` allows it.
    """
    names = [parsed(item) for item in items]
    dealt: list[tuple[T, ...]] = []
    begin = 0
    while begin < len(items):
        end = begin + min(most, -(-(len(items) - begin) // (PER_WORKER * workers)))
        end = _where_parting_is_cheap(names, begin, end, most)
        dealt.append(tuple(items[begin:end]))
        begin = end
    return dealt


def _where_parting_is_cheap(names: Sequence[str | None], begin: int, end: int, most: int) -> int:
    """``end``, or the nearest end of what is parsed as a whole: after it within ``most``, else
    before it; ``end`` itself where all of it is one."""

    def parts(place: int) -> bool:
        inside = 0 < place < len(names) and names[place] is not None
        return inside and names[place - 1] == names[place]

    after = next((p for p in range(end, begin + most + 1) if not parts(p)), None)
    if after is not None:
        return min(after, len(names))
    return next((p for p in range(end - 1, begin, -1) if not parts(p)), end)


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run that has a number in the store: who works on it, and what becomes of it.

    ``queued``: it comes from the queue, so it lies while the database is away, raises alerts and
    tells people. ``shown`` is how many valves its report shows, the worst; all where ``None``.
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


@dataclass(frozen=True, kw_only=True)
class Executed:
    """What came of the tasks: ``results`` in their order, without samples (an excerpt is left of
    valves that may need work); ``previous`` is what was found of each valve before."""

    results: ResultSpill
    previous: dict[str, PreviousFinding | None]
    not_saved: Sequence[tuple[str, str]] = ()


def execute(
    run: Run,
    tasks: Sequence[Task],
    stop: threading.Event,
    *,
    tell: Told = lambda *_: None,
    over: Over = lambda *_: None,
) -> Executed:
    """A screening for each task, in the tasks' order, whatever order they were done in.

    Each is saved and its samples let go as soon as it is there, so that memory does not grow with
    the valves and a run that is cut short loses what was not begun, no more. A task on which
    workers hung or died has a screening with that reason. Ends early when ``stop`` is set.
    """
    tasks = with_what_was_found(tasks, run.store)
    results = ResultSpill(MOST_PLOTTED)
    saving = Saving(
        run.store,
        run.number,
        run.started,
        tasks,
        new_baseline=run.new_baseline,
        must_save=run.queued,
        over=over,
    )
    for done in _screened(run, tasks, stop):
        arrived = [_put(results, outcome) for outcome in done]
        saving.take(arrived, results)
        for nth, result in enumerate(arrived, start=len(results) - len(arrived) + 1):
            tell(result.screening, nth, len(tasks))
    return Executed(results=results, previous=saving.previous, not_saved=tuple(saving.not_saved))


def add_unsaved(run: Run, executed: Executed, tasks: Sequence[Task], stop: threading.Event) -> None:
    """Screen tasks again whose results are in the store, for their plots; nothing is saved."""
    first = len(executed.results)
    for done in _screened(run, with_what_was_found(tasks, run.store), stop):
        for outcome in done:
            result = _put(executed.results, outcome, first)
            before = run.store.previous_finding(result.screening, run.started)
            executed.previous[result.screening.valve] = before


def _screened(
    run: Run, tasks: Sequence[Task], stop: threading.Event
) -> Iterator[list[Outcome[Task, tuple[Screening, ValvePlots]]]]:
    batches = make_batches(tasks, run.executor.workers)
    return outcomes(run.executor, partial(screen_packed, run.limits, os.getcwd()), batches, stop)


def make_batches(tasks: Sequence[Task], workers: int) -> list[tuple[Task, ...]]:
    """``tasks`` as they are dealt to ``workers``: valves of one file to one of them, unless others
    would have nothing to do meanwhile."""
    whole = not _worth_parting(tasks, workers)
    return make_chunks(tasks, workers, CHUNK, lambda task: task.text_file if whole else None)


def _worth_parting(tasks: Sequence[Task], workers: int) -> bool:
    """Whether several workers had better parse the same files: many valves in fewer files than
    there are workers, each soon read and small enough to be in the memory of every worker."""
    files = {task.text_file for task in tasks}
    if len(tasks) < WORTH_PARTING or len(files) >= workers:
        return False
    try:
        return sum(Path(file).stat().st_size for file in files if file) <= PARTED_UP_TO
    except OSError:  # whoever reads it says why
        return False


def _put(
    results: ResultSpill, outcome: Outcome[Task, tuple[Screening, ValvePlots]], first: int = 0
) -> PlacedScreening:
    """The outcome of a task on the disk, and what is saved of it."""
    place = first + outcome.place
    if outcome.result is None:
        screening, evidence = plots_instead_of_samples(given_up(outcome.item, outcome.reason))
    else:
        screening, evidence = outcome.result
    results.add(place, screening, evidence)
    return PlacedScreening(place=place, screening=screening, given_up=outcome.reason)
