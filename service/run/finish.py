"""The end of a run: false-discovery control, alerts, report, work list, messages.

Each step can be repeated after an interruption without raising or sending anything twice.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

from stemwatch.models.oscillation_groups.over_windows import told_once
from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup, plant_groups
from stemwatch.models.screening_result import Screening
from stemwatch.models.statistics.false_discovery import significant
from stemwatch.models.words import counted
from stemwatch.service.alerts.digest import queue_messages
from stemwatch.service.alerts.evaluate import evaluate
from stemwatch.service.maintenance import write_maintenance
from stemwatch.service.maintenance.stored import background_of, facts_of, plant_facts
from stemwatch.service.maintenance.write_maintenance import WORK_FILES
from stemwatch.service.presenter.false_discoveries import (
    Discoveries,
    confirmed_slugs,
    p_in_run,
)
from stemwatch.service.report import ReportContext, ReportFiles, write_report
from stemwatch.service.report.report_context import SourceNotRead
from stemwatch.service.run.execute import Executed, Run
from stemwatch.service.run.spill import WorstScreenings
from stemwatch.service.store.screenings.false_discoveries import StandingMark, TestedScreening
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)
NotRead = Sequence[tuple[str, str]]  # sources that could not be read, each with the reason
MORE_THAN_ANY_PLANT = 1_000_000  # valves


def hold_back(store: Store, run_id: int) -> list[TestedScreening]:
    """Control false discoveries over the run: mark named effects that do not stand among all its
    valves, and what the windows of weeks confirm of those with a history. Returns every screening
    that was tested, each with the p value that its valve brings to the run.

    Repeating the call changes nothing. Raises ``StoreError``.
    """
    newest = store.tested_of_run(run_id)
    by_window = store.evidence([screening.valve for screening in newest])
    tested = [
        replace(
            screening,
            p_value=p_in_run(
                screening.p_value,
                defects=screening.defects,
                by_window=by_window.get(screening.valve),
            ),
        )
        for screening in newest
    ]
    stands_of_each = significant([screening.p_value for screening in tested])
    discoveries = Discoveries(
        standing=(), tested=len(tested), named=sum(stands_of_each), held_back=0
    )
    marks = {}
    for screening, stands in zip(tested, stands_of_each, strict=True):
        history = by_window.get(screening.valve)
        held_back = screening.named and not stands
        marks[screening.screening] = StandingMark(
            held_back=discoveries.remark(history) if held_back else "",
            confirmed=confirmed_slugs(history, stands=stands),
        )
    store.note_standing(run_id, marks)
    return tested


def p_elsewhere(
    tested: Sequence[TestedScreening], shown: Sequence[str]
) -> tuple[float | None, ...]:
    """The p values of the valves that are not ``shown`` in the report."""
    in_report = set(shown)
    return tuple(screening.p_value for screening in tested if screening.valve not in in_report)


@dataclass(frozen=True, kw_only=True)
class Finished:
    """The files of a report, ``None`` without one, and what the report says beside its screenings,
    so that the terminal can say the same."""

    files: ReportFiles | None = None
    context: ReportContext | None = None


def finish(run: Run, executed: Executed, not_read: NotRead = ()) -> Finished:
    """Control false discoveries, raise alerts, write report and work list, queue messages.

    For a queued run, files that cannot be written are only logged, since alerts matter more; for a
    run of the command line ``ReportNotWritten`` is raised.
    """
    tested = hold_back(run.store, run.number)
    if run.plant is not None and run.queued:
        evaluate(run.store, run.plant, run.number)
    else:
        run.store.finish_run(run.number)
    finished = Finished()
    if len(executed.results) or not run.queued:
        try:
            finished = _write(run, executed, not_read, tested)
        except OSError as error:
            if not run.queued:
                raise
            text = "run %d: the report could not be written: %s"
            log.error(text, run.number, error, extra={"run": run.number})
    if run.plant is not None and run.queued:
        queue_messages(run.store, run.plant, run_id=run.number)
    return finished


def _write(
    run: Run, executed: Executed, not_read: NotRead, tested: Sequence[TestedScreening]
) -> Finished:
    """Work list and report. The report is written even where the work list cannot be; its error is
    raised afterwards, for a run of the command line only.
    """
    context = _context(run, executed, not_read)
    failed: Exception | None = None
    try:
        _write_work_list(run, executed, context)
    except Exception as error:  # alerts and the report matter more than the work list
        failed = error
        if run.queued:
            text = "run %d: the maintenance report could not be written"
            log.exception(text, run.number, extra={"run": run.number})
    else:
        context = replace(context, work_files=WORK_FILES)
    if run.shown is None:
        files = write_report(executed.results, context, run.out, executed.results.evidence)
    else:
        files = _write_worst(run, executed.results.worst(run.shown), context, tested)
    if failed is not None and not run.queued:
        raise failed
    return Finished(files=files, context=context)


def _write_worst(
    run: Run,
    worst_screenings: WorstScreenings,
    context: ReportContext,
    tested: Sequence[TestedScreening],
) -> ReportFiles:
    """The report of the worst valves only, with a note on how many it leaves out."""
    valves_shown = [screening.valve for screening in worst_screenings]
    notes = context.sources_not_read
    all_valves = run.store.worst_of_run(run.number, MORE_THAN_ANY_PLANT)
    valves_not_shown = len(set(all_valves) - set(valves_shown))
    if valves_not_shown:
        less_severe = counted(
            valves_not_shown, "valve less severe than these is", "valves less severe than these are"
        )
        text = f"{less_severe} in the ranking of the service only"
        notes = (*notes, SourceNotRead(source="this report", reason=text))
    elsewhere = p_elsewhere(tested, valves_shown)
    part = replace(context, sources_not_read=notes, p_elsewhere=elsewhere)
    return write_report(worst_screenings, part, run.out, worst_screenings.evidence)


def _write_work_list(run: Run, executed: Executed, context: ReportContext) -> None:
    """Pages and work orders of all valves of the run; those that an earlier process screened are
    taken from the store."""
    background = background_of(run.store, run.plant, run.number)
    screenings: Sequence[Screening] = executed.results
    if run.queued:
        other_valves = [
            screening
            for screening in run.store.screenings_of_run(run.number)
            if screening.valve not in executed.previous
        ]
        if other_valves:
            screenings = [*executed.results, *other_valves]
            facts = facts_of(run.store, run.plant, other_valves)
            context = replace(context, valves={**context.valves, **facts})
    write_maintenance(screenings, context, run.out, background)


def _groups(run: Run, executed: Executed) -> tuple[OscillationGroup, ...]:
    """Groups of loops of the run that oscillate together, stored and linked with those of earlier
    windows, each oscillation once, by its newest window; none where the search fails, since
    everything else matters more."""
    try:
        valves = list(run.plant.valves.values()) if run.plant else []
        units = {valve.id: valve.unit for valve in valves}
        feeds = {valve.id: valve.feeds for valve in valves}
        groups = plant_groups(executed.results.thinned_loops(), units, feeds)
        return tuple(told_once(run.store.keep_oscillations(run.number, groups)))
    except Exception:
        text = "run %d: loops that oscillate together could not be looked for"
        log.exception(text, run.number, extra={"run": run.number})
        return ()


def _context(run: Run, executed: Executed, not_read: NotRead) -> ReportContext:
    """What the report says beside the screenings, of valves, sources, groups and the run."""
    plant = run.plant
    notes = [SourceNotRead(source=source, reason=reason) for source, reason in not_read]
    if run.queued:
        aside = run.store.queue.set_aside(run.number)
        notes += [SourceNotRead(source=valve, reason=reason) for valve, reason in aside]
    if plant is not None:
        notes += [
            SourceNotRead(source=str(problem.file), reason=str(problem))
            for problem in plant.problems
        ]
    valves = list(executed.previous)
    weeks, by_window = run.store.trends(valves, run.limits), run.store.evidence(valves)
    return ReportContext(
        started=run.started,
        plant=plant.name if plant else "",
        zone=run.zone,
        command=run.command,
        settings_digest=plant.settings_digest if plant else "",
        valves={
            valve: replace(
                plant_facts(plant, valve, before),
                weeks=weeks.get(valve),
                by_window=by_window.get(valve),
                earlier_suspicion=executed.earlier_suspicions.get(valve),
            )
            for valve, before in executed.previous.items()
        },
        sources_not_read=tuple(notes),
        outside_window=executed.outside_window.sentence,
        groups=_groups(run, executed),
        currency=plant.currency if plant else "",
        rank_by=run.rank_by,
    )
