"""The overview: how many valves need work, how that went over the weeks, whether the data are
fresh, the last run and the next."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from threading import Lock

import numpy as np
from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse
from markupsafe import Markup

from stemwatch.models.history.trend_over_weeks import WEEKS
from stemwatch.service.presenter.stale_data import DueSchedule, SilentSource, stale_data
from stemwatch.service.presenter.suspicion_words import (
    SUSPECTED_NOTE,
    loops_to_test,
    next_steps,
    suspected_sentence,
)
from stemwatch.service.presenter.work_counts import WorkCounts
from stemwatch.service.presenter.work_decision import WorkState
from stemwatch.service.report.change_since_last_run import change_since_last_run
from stemwatch.service.report.charts.small_plot import PlottedLine, SmallPlot
from stemwatch.service.store.runs.schedules import StoredSchedule
from stemwatch.service.store.screenings.ranking import RankingFilter
from stemwatch.service.store.screenings.records import RunState, StoredRun
from stemwatch.service.web.dependencies import Dependencies, Deps
from stemwatch.service.web.pages.runs_page import is_alive
from stemwatch.service.web.pages.sources_page import source_word

WORST = 10
RECENT_RUNS = 50
MOST_KEPT = 64  # of the counts of weeks that are over

router = APIRouter(include_in_schema=False)


@dataclass(frozen=True, kw_only=True)
class Week:
    """How many valves stood where at ``until``."""

    until: datetime
    counts: WorkCounts


class _CountsOfWeeks:
    """Weekly counts, kept until another run is over, since each count reads all valves."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, int, datetime], WorkCounts] = OrderedDict()
        self._lock = Lock()

    def of(self, deps: Dependencies, run: int, until: datetime) -> WorkCounts:
        key = (id(deps.store), run, until)
        with self._lock:
            if key in self._kept:
                return self._kept[key]
        counts = deps.store.work_counts(until)
        with self._lock:
            self._kept[key] = counts
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return counts


_counts = _CountsOfWeeks()


@router.get("/overview")
def overview(request: Request, deps: Deps) -> HTMLResponse:
    """The plant on one page."""
    groups = deps.standing_groups()
    ranking = deps.store.ranking(RankingFilter(size=WORST), groups=groups)
    newest = deps.store.ranking(RankingFilter(sort="at", descending=True, size=1))
    runs = deps.store.queue.recent(RECENT_RUNS)
    schedules = deps.store.schedules.all()
    last = _last(runs)
    weeks = weeks_of(deps, 0 if last is None else last.id)
    trends = deps.store.trends([line.valve for line in ranking.lines], deps.site.limits)
    steps = next_steps(deps.store.without_verdict(), groups)
    worst = [line for line in ranking.lines if line.state not in (None, WorkState.NO_WORK)]
    return deps.renderer.page(
        request,
        "overview_page.html",
        here="overview",
        open_alerts=deps.open_alerts(),
        work=WorkCounts.of_states(ranking.states, ranking.orders),
        not_screened=sum(ranking.counts.values()) - sum(ranking.states.values()),
        stale=_stale(deps, schedules, last, newest.lines[0].at if newest.lines else None),
        going=[run for run in runs if is_alive(run)],
        last=last,
        coming=_coming(schedules),
        switched_off=any(not schedule.schedule.enabled for schedule in schedules),
        weeks=weeks,
        picture=picture_of(weeks),
        suspected=suspected_sentence(loops_to_test(steps)),
        suspected_note=SUSPECTED_NOTE,
        to_test=loops_to_test(steps),
        next_steps=steps,
        oscillations=groups,
        worst=[
            (line, change_since_last_run(line, line.verdict, line.previous, trends.get(line.valve)))
            for line in worst
        ],
    )


def _last(runs: Sequence[StoredRun]) -> StoredRun | None:
    """The newest run that is over. An instant that was skipped because a run was not over yet is
    none: it would hide how that run ended."""
    over = [run for run in runs if not is_alive(run)]
    worked = (run for run in over if run.state is not RunState.SKIPPED)
    return next(worked, over[0] if over else None)


def weeks_of(deps: Dependencies, run: int) -> list[Week]:
    """The end of each of the last weeks that has results, and now, the oldest first. ``run`` is
    the last that is over."""
    now = deps.now
    local = now.astimezone(deps.site.tz)
    monday = local.replace(hour=0, minute=0, second=0, microsecond=0) - timedelta(
        days=local.weekday()
    )
    ends = [monday - timedelta(weeks=weeks_back) for weeks_back in range(WEEKS - 2, -1, -1)]
    weeks = [Week(until=end, counts=_counts.of(deps, run, end)) for end in ends]
    weeks.append(Week(until=now, counts=deps.store.work_counts(now)))
    return [week for week in weeks if week.counts.valves]


def picture_of(weeks: list[Week]) -> Markup | None:
    """The counts of the weeks as lines; ``None`` for less than two."""
    if len(weeks) < 2:
        return None
    days = np.array([(week.until - weeks[-1].until).total_seconds() / 86400.0 for week in weeks])
    lines = (
        ("needs", "need work", [week.counts.needs_work for week in weeks], False),
        ("unjudged", "cannot be judged", [week.counts.not_judged for week in weeks], True),
        ("watched", "to watch", [week.counts.watch for week in weeks], False),
    )
    top = max(4, *(count for _, _, counts, _ in lines for count in counts))
    plot = SmallPlot(
        x_label="days before now",
        y_label="valves",
        description=f"Valves that need work over {len(weeks)} weeks, now "
        f"{weeks[-1].counts.needs_work} of {weeks[-1].counts.valves}.",
        lines=[
            PlottedLine(kind, label, days, np.array(counts, dtype=np.float64), dashed=dashed)
            for kind, label, counts, dashed in lines
        ],
        limits=(float(days[0]) - 1.0, 1.0, 0.0, 1.08 * top),
        width=480,
    )
    return plot.svg()


def _stale(
    deps: Dependencies,
    schedules: list[StoredSchedule],
    last: StoredRun | None,
    newest: datetime | None,
) -> list[str]:
    silent = [
        SilentSource(name=state.source, last_good=state.last_good, fault=state.fault)
        for state in deps.store.sources.states()
        if source_word(state, deps.now) != "good"
    ]
    return stale_data(
        deps.now,
        newest=newest,
        schedules=[
            DueSchedule(
                name=schedule.schedule.name,
                next_due=schedule.next_due,
                spread=timedelta(seconds=schedule.schedule.jitter_s),
            )
            for schedule in schedules
            if schedule.schedule.enabled
        ],
        silent=silent,
        failed=""
        if last is None or last.state is not RunState.FAILED
        else last.reason or "see its page",
    )


def _coming(schedules: list[StoredSchedule]) -> StoredSchedule | None:
    """The schedule that is due first."""
    due = [
        schedule
        for schedule in schedules
        if schedule.schedule.enabled and schedule.next_due is not None
    ]
    return min(due, key=lambda schedule: (schedule.next_due, schedule.schedule.name), default=None)
