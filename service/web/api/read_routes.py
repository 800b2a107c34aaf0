"""The API that reads: ``/api/v1``, the same facts as the pages, as JSON."""

from __future__ import annotations

import math
from datetime import timedelta
from typing import Annotated, Literal

from fastapi import APIRouter, HTTPException, Query
from pydantic import AwareDatetime

from stemwatch.models.estimate import Estimate
from stemwatch.service.access.permissions import Operation
from stemwatch.service.plant_path import PartOfPlant, levels_of
from stemwatch.service.presenter.cost_of_sticking import CostOfSticking, money_of
from stemwatch.service.presenter.suspicion_words import next_steps
from stemwatch.service.store.alerts.alerts import StoredAlert, state_of
from stemwatch.service.store.screenings.ranking import (
    MOST_PAGE,
    PAGE,
    RankingFilter,
    RankingLine,
    Sort,
)
from stemwatch.service.store.screenings.records import StoredRun
from stemwatch.service.store.screenings.restored import screening_of
from stemwatch.service.web.actions import LARGEST_NUMBER
from stemwatch.service.web.api import history, signals
from stemwatch.service.web.api import loop as phase
from stemwatch.service.web.api import schemas as shapes
from stemwatch.service.web.api.schemas import MeAnswer
from stemwatch.service.web.api.signals import window_of
from stemwatch.service.web.auth.current_user import SignedIn
from stemwatch.service.web.dependencies import Dependencies, Deps

Id = Annotated[str, Query(alias="id", min_length=1, max_length=500, description="the valve's id")]
Number = Annotated[int, Query(ge=1, le=LARGEST_NUMBER)]
Word = Literal["sticky", "defective", "watch", "undetermined", "healthy", "none"]
Names = Annotated[list[str], Query(max_length=100)]
State = Literal["open", "acknowledged", "snoozed", "closed", "false", "all"]

NEWEST_RUNS = 5  # of which a page notices that something changed

router = APIRouter(prefix="/api/v1", tags=["read"], responses=shapes.REFUSALS)


@router.get("/valves")
def valves(
    deps: Deps,
    q: Annotated[str, Query(max_length=200, description="in tag, service or area")] = "",
    site: Names = [],  # noqa: B006  # read, never changed
    area: Names = [],  # noqa: B006
    unit: Names = [],  # noqa: B006
    verdict: Annotated[list[Word], Query(max_length=6)] = [],  # noqa: B006
    criticality: Annotated[list[Literal["1", "2", "3"]], Query(max_length=3)] = [],  # noqa: B006
    sort: Sort = "rank",
    order: Literal["asc", "desc"] = "asc",
    page: Annotated[int, Query(ge=1, le=10_000)] = 1,
    size: Annotated[int, Query(ge=1, le=MOST_PAGE)] = PAGE,
) -> shapes.RankingAnswer:
    """The valves with their latest findings, the most urgent first unless asked otherwise.

    A site, area or unit that no valve is in is refused with the names there are.
    """
    ranking_filter = RankingFilter(
        text=q,
        sites=tuple(site),
        areas=tuple(area),
        units=tuple(unit),
        verdicts=tuple(verdict),
        criticalities=tuple(int(level) for level in criticality),
        sort=sort,
        descending=order == "desc",
        page=page,
        size=size,
    )
    costs = deps.site.costs()
    ranked = deps.store.ranking(ranking_filter, money_of(costs), deps.standing_groups())
    if complaint := ranked.unknown(ranking_filter):
        raise HTTPException(422, complaint)
    lines = [valve_line(line, costs.get(line.valve)) for line in ranked.lines]
    return shapes.RankingAnswer(
        total=ranked.total, page=page, size=size, counts=dict(ranked.counts), valves=lines
    )


@router.get("/valve/signals")
def valve_signals(
    deps: Deps, valve: Id, start: AwareDatetime, stop: AwareDatetime
) -> shapes.SignalsAnswer:
    """OP, MV, PV and SP between two instants, thinned to what can be seen."""
    window = window_of(deps.need_valve(valve), start, stop)
    return signals.signals_of(deps.site, window)


@router.get("/valve/loop")
def valve_loop(
    deps: Deps, valve: Id, start: AwareDatetime, stop: AwareDatetime
) -> shapes.LoopAnswer:
    """MV against OP with the loop of the model that was fitted last; at most twelve hours."""
    window = window_of(deps.need_valve(valve), start, stop)
    latest = deps.store.screenings(valve, 1)
    points = deps.store.indicators(latest[0].id) if latest else {}
    numbers = {name: point.value for name, point in points.items() if point.value is not None}
    screening = screening_of(latest[0]) if latest else None
    return phase.loop_of(deps.site, window, numbers, screening)


@router.get("/valve/history")
def valve_history(
    deps: Deps, valve: Id, months: Annotated[int, Query(ge=1, le=240)] = 240
) -> shapes.HistoryAnswer:
    """S and J over months, the limits, and what happened to the valve."""
    since = deps.now - timedelta(days=31 * months)
    return history.history_of(deps, deps.need_valve(valve), since)


@router.get("/oscillations")
def oscillations(deps: Deps) -> list[shapes.OscillationAnswer]:
    """Loops that oscillated together within the last 30 days, the standing groups first."""
    return [
        shapes.OscillationAnswer(
            period_s=kept.group.period_s,
            source=kept.group.source or None,
            outside_probability=kept.group.outside,
            members=[
                shapes.OscillationMember(
                    loop=member.loop,
                    share=member.share,
                    probability=member.probability,
                    evidence=list(member.evidence),
                )
                for member in kept.group.members
            ],
            since=kept.group.since,
            first_found=kept.group.first_found or kept.group.start,
            windows=kept.group.windows,
            until=kept.at,
            over=kept.over,
        )
        for kept in deps.store.oscillations(deps.now)
    ]


@router.get("/next-steps")
def steps_without_verdict(deps: Deps) -> list[shapes.NextStepAnswer]:
    """Which loops deserve a position transmitter or a test first, and what to do at the other
    valves whose latest window has no verdict."""
    return [
        shapes.NextStepAnswer(
            verdict=step.verdict.value, why=step.why, step=step.step, loops=list(step.loops)
        )
        for step in next_steps(deps.store.without_verdict(), deps.standing_groups())
    ]


@router.get("/alerts")
def alert_list(
    deps: Deps,
    state: State = "open",
    area: Names = [],  # noqa: B006
    unit: Names = [],  # noqa: B006
) -> list[shapes.AlertLine]:
    """Alerts in a state, the newest first; with an area or unit those of its valves."""
    part = PartOfPlant(areas=tuple(area), units=tuple(unit))
    alerts = deps.store.alerts.in_state(state, deps.now, part=part)
    return [alert_line(alert, deps) for alert in alerts]


@router.get("/changes")
def changes(deps: Deps) -> shapes.ChangesAnswer:
    """What changes when a run begins, goes on or is over, or an alert comes or goes: a page that
    shows results asks for it often, and for itself only when this is another."""
    newest = deps.store.queue.recent(NEWEST_RUNS)
    return shapes.ChangesAnswer(
        runs=[f"{run.id} {run.state.value} {run.done}" for run in newest],
        open_alerts=deps.open_alerts(),
    )


@router.get("/runs")
def runs(deps: Deps, limit: Annotated[int, Query(ge=1, le=500)] = 100) -> list[shapes.RunAnswer]:
    """Runs, the newest first, with their progress."""
    return [run_answer(run, deps) for run in deps.store.queue.recent(limit)]


@router.get("/run")
def run(deps: Deps, number: Annotated[Number, Query(alias="id")]) -> shapes.RunAnswer:
    """One run with its progress and the time left."""
    run = deps.store.queue.find(number)
    if run is None:
        raise HTTPException(404, f"there is no run {number}")
    return run_answer(run, deps)


@router.get("/sources")
def sources(deps: Deps) -> list[shapes.SourceAnswer]:
    """How each source of data is doing."""
    return [
        shapes.SourceAnswer(
            source=state.source,
            kind=state.kind,
            address=state.address,
            updated=state.updated,
            last_good=state.last_good,
            connected=state.connected,
            fault=state.fault,
            figures={name: finite(value) for name, value in state.figures.items()},
        )
        for state in deps.store.sources.states()
    ]


@router.get("/schedules")
def schedules(deps: Deps) -> list[shapes.ScheduleAnswer]:
    """When which valves are screened."""
    return [
        shapes.ScheduleAnswer(
            name=schedule.schedule.name,
            cron=schedule.schedule.cron,
            every_s=schedule.schedule.every_s,
            window_s=schedule.schedule.window_s,
            areas=list(schedule.schedule.areas),
            units=list(schedule.schedule.units),
            valves=list(schedule.schedule.valves),
            enabled=schedule.schedule.enabled,
            last_due=schedule.last_due,
            next_due=schedule.next_due,
        )
        for schedule in deps.store.schedules.all()
    ]


@router.get("/me")
def me(current_user: SignedIn) -> MeAnswer:
    """Who asks, and what that allows."""
    scopes = None if current_user.scopes is None else sorted(current_user.scopes)
    return MeAnswer(
        name=current_user.name,
        role=current_user.role,
        how=current_user.signed_in_by,
        scopes=scopes,
        may=[operation.value for operation in Operation if current_user.may(operation)],
    )


def valve_line(line: RankingLine, cost: CostOfSticking | None = None) -> shapes.ValveLine:
    """A line of the ranking for the API."""
    return shapes.ValveLine(
        valve=line.valve,
        description=line.description,
        **levels_of(line),
        criticality=line.criticality,
        verdict=None if line.verdict is None else line.verdict.value,
        ne107=line.ne107,
        stem_verdict=None if line.stem_verdict is None else line.stem_verdict.value,
        at=line.at,
        severity=line.severity,
        priority=None if line.priority is None else line.priority.code,
        confidence=line.sure,
        stem_confidence=line.confidence,
        grade=line.grade,
        shape=line.shape,
        S=_estimated(line.S),
        J=_estimated(line.J),
        cost_per_month=None if cost is None else _estimated(cost.money),
        left_out=list(line.left_out),
        held_back=line.held_back,
    )


def alert_line(alert: StoredAlert, deps: Dependencies) -> shapes.AlertLine:
    """``alert`` with the fields that the API promises, its state as of now."""
    names = set(shapes.AlertLine.model_fields) - {"state", "kind", "severity"}
    return shapes.AlertLine(
        state=state_of(alert, deps.now),
        kind=alert.kind.value,
        severity=alert.severity.value,
        **{name: getattr(alert, name) for name in names},
    )


def run_answer(run: StoredRun, deps: Dependencies) -> shapes.RunAnswer:
    """``run`` with the fields that the API promises, progress and time left among them."""
    return shapes.RunAnswer(
        id=run.id,
        state=run.state.value,
        schedule=run.schedule,
        who=run.who,
        started=run.started,
        finished=run.finished,
        total=run.total,
        done=run.done,
        set_aside=run.set_aside,
        left_s=run.left_s(deps.now),
        reason=run.reason,
        counts={verdict.value: count for verdict, count in run.counts.items()},
    )


def finite(value: object) -> float | None:
    """A number that JSON has, or ``None``."""
    is_finite = isinstance(value, int | float) and math.isfinite(value)
    return float(value) if is_finite and isinstance(value, int | float) else None


def _estimated(estimate: Estimate) -> shapes.Estimated:
    return shapes.Estimated(
        value=estimate.value, low=estimate.low, high=estimate.high, reason=estimate.reason
    )
