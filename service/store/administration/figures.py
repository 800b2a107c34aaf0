"""The counts for ``/metrics``: a fixed number of queries, whatever the number of valves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import case, func, select
from sqlalchemy.orm import Session

from stemwatch.service.store.alerts.tables import AlertRow, DeliveryRow
from stemwatch.service.store.screenings.ranking import NOT_SCREENED
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.screenings.screenings import count_overall, latest_screening_id
from stemwatch.service.store.screenings.tables import RunRow, ScreeningRow, ValveRow
from stemwatch.service.store.store import Store

_GOING = (RunState.WAITING.value, RunState.RUNNING.value)


@dataclass(frozen=True, kw_only=True)
class LastRun:
    """The last finished run: its duration in seconds, and mean and largest time for one valve."""

    seconds: float
    valve_mean_s: float
    valve_max_s: float
    finished_s: float  # seconds since 1970


@dataclass(frozen=True, kw_only=True)
class StoreFigures:
    """Counts of runs, valves, alerts and messages, by the values of the metrics' labels."""

    runs: Mapping[str, int]  # by ``RunState``
    set_aside: int
    valves_to_do: int
    last_run: LastRun | None
    verdicts: Mapping[str, int]  # of the latest screening of each valve
    alerts: Mapping[tuple[str, str], int]  # open ones, by kind and severity
    deliveries: Mapping[tuple[str, str], int]  # by notifier and state


def figures_of(store: Store) -> StoreFigures:
    """The present counts. Raises ``StoreError``."""
    with store.transactions.reading("counting") as session:
        return _figures(session)


def _figures(session: Session) -> StoreFigures:
    runs = _counts(session, select(RunRow.state, func.count()).group_by(RunRow.state))
    to_do = func.coalesce(func.sum(RunRow.total - RunRow.done), 0)
    return StoreFigures(
        runs=runs,
        set_aside=session.scalar(select(func.coalesce(func.sum(RunRow.set_aside), 0))) or 0,
        valves_to_do=session.scalar(select(to_do).where(RunRow.state.in_(_GOING))) or 0,
        last_run=_last_run(session),
        verdicts=_verdicts(session),
        alerts=_alerts(session),
        deliveries=_deliveries(session),
    )


def _counts(session: Session, statement: Any) -> dict[str, int]:
    return {name: count for name, count in session.execute(statement)}


def _last_run(session: Session) -> LastRun | None:
    newest = select(RunRow.id, RunRow.started, RunRow.finished).where(
        RunRow.state == RunState.DONE.value, RunRow.finished.is_not(None)
    )
    run = session.execute(newest.order_by(RunRow.id.desc()).limit(1)).first()
    if run is None:
        return None
    of_run = select(func.avg(ScreeningRow.seconds), func.max(ScreeningRow.seconds))
    mean, longest = session.execute(of_run.where(ScreeningRow.run_id == run.id)).one()
    return LastRun(
        seconds=max(0.0, (run.finished - run.started).total_seconds()),
        valve_mean_s=float(mean or 0.0),
        valve_max_s=float(longest or 0.0),
        finished_s=run.finished.timestamp(),
    )


def _verdicts(session: Session) -> dict[str, int]:
    latest = ScreeningRow.id == latest_screening_id()
    joined = select(ScreeningRow).select_from(ValveRow).join(ScreeningRow, latest)
    counts = count_overall(session, joined)
    valves = session.scalar(select(func.count()).select_from(ValveRow)) or 0
    return {**counts, NOT_SCREENED: valves - sum(counts.values())}


def _alerts(session: Session) -> dict[tuple[str, str], int]:
    statement = (
        select(AlertRow.kind, AlertRow.severity, func.count())
        .where(AlertRow.closed.is_(None), AlertRow.false_alarm.is_(False))
        .group_by(AlertRow.kind, AlertRow.severity)
    )
    return {(kind, severity): count for kind, severity, count in session.execute(statement)}


def _deliveries(session: Session) -> dict[tuple[str, str], int]:
    """By notifier and state: sent, given up, waiting for the first attempt, or failing so far."""
    state = case(
        (DeliveryRow.sent.is_not(None), "sent"),
        (DeliveryRow.given_up.is_(True), "given_up"),
        (DeliveryRow.error != "", "failing"),
        else_="waiting",
    )
    statement = select(DeliveryRow.notifier, state, func.count())
    rows = session.execute(statement.group_by(DeliveryRow.notifier, state))
    return {(notifier, state_name): count for notifier, state_name, count in rows}
