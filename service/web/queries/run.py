"""One run and what became of its valves."""

from __future__ import annotations

from dataclasses import dataclass

from sqlalchemy import select
from sqlalchemy.orm import Session

from stemwatch.service.store.runs.tables import RunValveRow
from stemwatch.service.store.screenings.records import StoredRun
from stemwatch.service.store.screenings.rows import stored_run
from stemwatch.service.store.screenings.tables import RunRow

MOST_SET_ASIDE = 500


@dataclass(frozen=True, kw_only=True)
class SetAside:
    """A valve that a run could not screen, and why."""

    valve: str
    state: str
    reason: str


def read_run(session: Session, number: int) -> StoredRun | None:
    """One run, or ``None`` where there is none of this number."""
    row = session.get(RunRow, number)
    return None if row is None else stored_run(row)


def read_set_aside(session: Session, number: int) -> list[SetAside]:
    """The valves of a run that have a reason beside their state; at most ``MOST_SET_ASIDE``."""
    statement = select(RunValveRow).where(RunValveRow.run_id == number, RunValveRow.reason != "")
    rows = session.scalars(statement.order_by(RunValveRow.valve).limit(MOST_SET_ASIDE))
    return [SetAside(valve=row.valve, state=row.state, reason=row.reason) for row in rows]
