"""The main flow of the service on one page.

    request -> plan -> screen (in any executor) -> store -> report

Nothing here knows how a file is read or how a valve is judged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import accumulate
from pathlib import Path

from stemwatch.models.limits import Limits
from stemwatch.models.screening_result import PreviousFinding, Residual, Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service import __version__
from stemwatch.service.alerts.held_back import hold_back
from stemwatch.service.config import Plant
from stemwatch.service.executors import Executor
from stemwatch.service.maintenance import write_maintenance
from stemwatch.service.maintenance.stored import background_of
from stemwatch.service.report import ReportContext, ReportFiles, write_report
from stemwatch.service.report.html_page import MOST_PLOTTED
from stemwatch.service.report.report_context import SourceNotRead, ValveFacts
from stemwatch.service.run.chunking import make_chunks
from stemwatch.service.run.plan import Plan, Request, make_plan
from stemwatch.service.run.spill import ResultSpill
from stemwatch.service.run.task import Chunk, StoredBaseline, Task, screen_packed
from stemwatch.service.store.database_url import masked_command
from stemwatch.service.store.store import Store

# Valves that one worker takes at a time. Their networks train together, which is quicker; but every
# worker should have some, and progress should be seen.
CHUNK = 16
JUDGED = (Verdict.HEALTHY, Verdict.WATCH, Verdict.STICKY)

Told = Callable[[Screening, int, int], None]  # a screening is there: it, how many done, of how many


@dataclass(frozen=True, kw_only=True)
class Run:
    """What a run needs beside its request."""

    store: Store
    executor: Executor
    out: Path
    limits: Limits = field(default_factory=Limits)
    command: tuple[str, ...] = ()
    new_baseline: bool = False  # make this window each valve's baseline, whatever there was


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """What came out.

    ``screenings`` are those of the tasks in their order, without their samples (an excerpt is left
    of valves that need work); they are read from a disk when they are asked for. ``brief`` are the
    same in memory, with as much as a line of text needs.
    """

    screenings: Sequence[Screening]
    brief: tuple[Screening, ...]
    report: ReportFiles
    not_read: tuple[tuple[str, str], ...]
    not_saved: tuple[tuple[str, str], ...]


def run(request: Request, how: Run, tell: Told = lambda *_: None) -> RunResult:
    """Screen everything a request names. Raises ``UnreadableSource`` and ``StoreError``.

    Each piece of work is saved and its samples let go as soon as it is done, so that memory does
    not grow with the valves.
    """
    started = datetime.now(UTC)
    planned = make_plan(request)
    digest = request.plant.settings_digest if request.plant else ""
    number = how.store.begin_run(
        command=how.command, software_version=__version__, settings_digest=digest
    )
    if request.plant is not None:
        how.store.save_valves(request.plant.valves.values())
    tasks = with_baselines(planned.tasks, how.store)
    compared = baselines_of(tasks)
    previous: dict[str, PreviousFinding | None] = {}
    not_saved: list[tuple[str, str]] = []

    def keep(screenings: Sequence[Screening]) -> None:
        """Save what is done at once: a run that is cut short loses what was not begun, no more."""
        previous.update({one.valve: how.store.previous_finding(one, started) for one in screenings})
        saved = how.store.save_many(screenings, number, compared)
        not_saved.extend((failure.valve, failure.reason) for failure in saved.failures)

    spill, brief = screen_all(tasks, how, tell, keep)
    _keep_networks(spill, how)
    hold_back(how.store, number)
    how.store.finish_run(number)
    context = _context(request, how, planned, previous, started, digest)
    report = write_report(spill, context, how.out, spill.evidence)
    background = background_of(how.store, request.plant, number)
    write_maintenance(spill, context, how.out, background)
    return RunResult(
        screenings=spill,
        brief=brief,
        report=report,
        not_read=planned.not_read,
        not_saved=tuple(not_saved),
    )


def screen_all(
    tasks: Sequence[Task], how: Run, tell: Told, keep: Callable[[Sequence[Screening]], None]
) -> tuple[ResultSpill, tuple[Screening, ...]]:
    """A screening for each task, in the tasks' order, whatever order they were done in.

    ``keep`` gets each chunk's screenings as soon as they are there.
    """
    dealt = make_chunks(tasks, how.executor.workers, CHUNK, parsed=lambda task: task.text_file)
    chunks = [Chunk(tasks=share, limits=how.limits) for share in dealt]
    firsts = list(accumulate((len(chunk.tasks) for chunk in chunks), initial=0))
    spill, brief = ResultSpill(MOST_PLOTTED), dict[int, Screening]()
    for number, found in how.executor.map(screen_packed, chunks):
        keep([screening for screening, _ in found])
        for place, (screening, evidence) in enumerate(found, start=firsts[number]):
            spill.add(place, screening, evidence)
            brief[place] = in_brief(screening)
            tell(brief[place], len(brief), len(tasks))
    return spill, tuple(brief[place] for place in sorted(brief))


def in_brief(screening: Screening) -> Screening:
    """As much of a result as a line of text needs: 2 KB."""
    nothing: dict[str, Residual | None] = {}
    return replace(
        screening.without_samples(), indicators={}, residuals=nothing, mismatch=None, network=None
    )


def with_baselines(tasks: Sequence[Task], store: Store) -> list[Task]:
    """Each task with its valve's baseline network, where the store has one."""
    found: dict[str, StoredBaseline | None] = {}
    for task in tasks:
        valve = task.tags.valve
        if valve not in found:
            kept = store.baseline(valve)
            found[valve] = (
                None
                if kept is None
                else StoredBaseline(
                    network=kept.network, note=kept.note, window=kept.window, id=kept.id
                )
            )
    return [replace(task, baseline=found[task.tags.valve]) for task in tasks]


def baselines_of(tasks: Sequence[Task]) -> dict[str, int]:
    """The number of the baseline that each valve is compared with, where it has one."""
    return {
        task.tags.valve: task.baseline.id
        for task in tasks
        if task.baseline is not None and task.baseline.id is not None
    }


def _keep_networks(screenings: Iterable[Screening], how: Run) -> None:
    """Keep each valve's fitted network, and make it the baseline where one is due.

    A valve's first window with a network is its first baseline; a healthy one replaces a baseline
    that was not, and maintenance or the user's word replaces any.
    """
    for screening in screenings:
        keep_network(screening, how.store, new_baseline=how.new_baseline)


def keep_network(screening: Screening, store: Store, *, new_baseline: bool = False) -> None:
    """What ``_keep_networks`` does, for one valve. A second time it changes nothing."""
    if screening.network is None or screening.verdict not in JUDGED:
        return
    blob = screening.network.to_bytes()
    why = f"fitted to a window that was {screening.verdict.value}"
    store.set_fitted(screening.valve, blob, window=screening.window, reason=why)
    reason = _due(screening, store, new_baseline)
    if reason:
        store.set_baseline(screening.valve, blob, window=screening.window, reason=reason)


def _due(screening: Screening, store: Store, new_baseline: bool) -> str:
    """Why this window becomes the valve's baseline, or nothing."""
    state = screening.verdict.value
    if new_baseline:
        return f"window chosen by the user ({state})"
    kept = store.baseline(screening.valve)
    if kept is None:
        return f"first window with a fit ({state})"
    if kept.maintenance is not None and _after(screening, kept.maintenance.at):
        return f"first window after maintenance ({state})"
    if screening.verdict is Verdict.HEALTHY and f"({Verdict.HEALTHY.value})" not in kept.reason:
        return f"first healthy window ({state})"
    return ""


def _after(screening: Screening, instant: datetime) -> bool:
    start, _ = screening.window
    return start is not None and start >= instant


def _context(
    request: Request,
    how: Run,
    planned: Plan,
    previous: dict[str, PreviousFinding | None],
    started: datetime,
    digest: str,
) -> ReportContext:
    plant = request.plant
    facts = {valve: facts_of(plant, valve, before) for valve, before in previous.items()}
    not_read = [SourceNotRead(source=s, reason=why) for s, why in planned.not_read]
    if plant is not None:
        not_read += [
            SourceNotRead(source=str(problem.file), reason=str(problem))
            for problem in plant.problems
        ]
    return ReportContext(
        started=started,
        plant=plant.name if plant else "",
        zone=(plant.zone if plant else None) or request.read_options.zone or "UTC",
        command=masked_command(how.command),
        settings_digest=digest,
        valves=facts,
        sources_not_read=tuple(not_read),
    )


def facts_of(plant: Plant | None, valve: str, previous: PreviousFinding | None) -> ValveFacts:
    """What a report says of a valve beside its screening."""
    entry = plant.valves.get(valve) if plant else None
    if entry is None:
        return ValveFacts(previous=previous)
    return ValveFacts(
        description=entry.description,
        area=entry.area,
        criticality=str(entry.criticality),
        stroke=entry.stroke or "",
        previous=previous,
    )
