"""Alerts by their state, as the pages show them."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import ColumnElement, func, or_, select
from sqlalchemy.orm import Session

from stemwatch.service.store.alerts.alerts import AlertSeverity, StoredAlert, stored_alert
from stemwatch.service.store.alerts.tables import AlertRow

MOST_ALERTS = 200
STATES = ("open", "acknowledged", "snoozed", "closed", "false", "all")


def state_of(alert: StoredAlert, now: datetime) -> str:
    """Which of ``STATES`` an alert is in: a closed one is closed, whatever it was before."""
    if alert.closed is not None:
        return "closed"
    if alert.false_alarm:
        return "false"
    if alert.snoozed_until is not None and alert.snoozed_until > now:
        return "snoozed"
    return "open" if alert.acknowledged is None else "acknowledged"


def read_alerts(
    session: Session, state: str, now: datetime, *, valve: str | None = None
) -> list[StoredAlert]:
    """The newest ``MOST_ALERTS`` in one of ``STATES``; alerts that are not over by urgency."""
    statement = select(AlertRow).where(*_in_state(state, now))
    if valve is not None:
        statement = statement.where(AlertRow.valve == valve)
    newest = statement.order_by(AlertRow.opened.desc(), AlertRow.id.desc()).limit(MOST_ALERTS)
    found = [stored_alert(row) for row in session.scalars(newest)]
    if state in ("closed", "all"):
        return found
    return sorted(found, key=lambda alert: list(AlertSeverity).index(alert.severity))


def count_open(session: Session, now: datetime) -> int:
    """How many alerts nobody has seen yet."""
    counted = select(func.count()).select_from(AlertRow).where(*_in_state("open", now))
    return session.scalar(counted) or 0


def valves_with_alerts(session: Session, now: datetime) -> dict[str, int]:
    """How many open alerts each valve has; valves without one are left out."""
    statement = select(AlertRow.valve, func.count()).where(
        *_in_state("open", now), AlertRow.valve.is_not(None)
    )
    return {
        valve: count
        for valve, count in session.execute(statement.group_by(AlertRow.valve))
        if valve is not None
    }


def _in_state(state: str, now: datetime) -> list[ColumnElement[bool]]:
    if state == "all":
        return []
    if state == "closed":
        return [AlertRow.closed.is_not(None)]
    false_ones = AlertRow.false_alarm.is_(state == "false")
    alive: list[ColumnElement[bool]] = [AlertRow.closed.is_(None), false_ones]
    if state == "false":
        return alive
    if state == "snoozed":
        return [*alive, AlertRow.snoozed_until > now]
    awake = or_(AlertRow.snoozed_until.is_(None), AlertRow.snoozed_until <= now)
    seen = AlertRow.acknowledged
    return [*alive, awake, seen.is_not(None) if state == "acknowledged" else seen.is_(None)]
