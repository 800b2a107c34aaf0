"""Reading and writing networks, maintenance and notes, within a session of the ``Store``."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import Session

from stemwatch.service.store.screenings.records import Baseline, Remark, UtcWindow
from stemwatch.service.store.screenings.screenings import ensure_valve
from stemwatch.service.store.screenings.tables import (
    MaintenanceRow,
    NetworkRow,
    RemarkRow,
    ValveRow,
)
from stemwatch.service.store.storable import from_row

BASELINE = "baseline"
FITTED = "fitted"


def write_network(
    session: Session, valve: str, kind: str, network: bytes, window: UtcWindow, reason: str
) -> None:
    """Make ``network`` the active one of its kind. Older baselines are kept as inactive, older
    fitted networks are deleted."""
    ensure_valve(session, valve)
    # The lock makes the second of two writers wait here; it then replaces the first one's network.
    session.execute(select(ValveRow.id).where(ValveRow.id == valve).with_for_update())
    of_kind = (NetworkRow.valve == valve, NetworkRow.kind == kind)
    if kind == FITTED:
        session.execute(delete(NetworkRow).where(*of_kind))
    else:
        session.execute(update(NetworkRow).where(*of_kind, NetworkRow.active).values(active=False))
    session.add(
        NetworkRow(
            valve=valve,
            kind=kind,
            network=network,
            created=datetime.now(UTC),
            window_start=window[0],
            window_end=window[1],
            reason=reason,
            active=True,
        )
    )


def read_network(session: Session, valve: str, kind: str) -> Baseline | None:
    """The active network of one kind, with the first maintenance after its window."""
    statement = select(NetworkRow).where(
        NetworkRow.valve == valve, NetworkRow.kind == kind, NetworkRow.active
    )
    row = session.scalar(statement)
    return None if row is None else _baseline(session, row)


def write_remark(session: Session, table: type[RemarkRow], remark: Remark) -> None:
    """Add a remark to maintenance or notes."""
    ensure_valve(session, remark.valve)
    session.add(table(valve=remark.valve, at=remark.at, note=remark.note, who=remark.who))


def read_remarks(session: Session, table: type[RemarkRow], valve: str) -> list[Remark]:
    """A valve's remarks of one table, oldest first."""
    rows = session.scalars(select(table).where(table.valve == valve).order_by(table.at, table.id))
    return [_remark(row) for row in rows]


def last_work(session: Session, valves: Sequence[str]) -> dict[str, datetime]:
    """The last work on each of ``valves`` that was worked on."""
    work = select(MaintenanceRow.valve, func.max(MaintenanceRow.at))
    work = work.where(MaintenanceRow.valve.in_(valves)).group_by(MaintenanceRow.valve)
    return {valve: work_time for valve, work_time in session.execute(work)}


def _baseline(session: Session, row: NetworkRow) -> Baseline:
    return Baseline(
        id=row.id,
        valve=row.valve,
        network=row.network,
        created=row.created,
        window=(row.window_start, row.window_end),
        reason=row.reason,
        maintenance=_first_maintenance(session, row.valve, row.window_end or row.created),
    )


def _first_maintenance(session: Session, valve: str, since: datetime) -> Remark | None:
    statement = (
        select(MaintenanceRow)
        .where(MaintenanceRow.valve == valve, MaintenanceRow.at >= since)
        .order_by(MaintenanceRow.at, MaintenanceRow.id)
        .limit(1)
    )
    row = session.scalar(statement)
    return None if row is None else _remark(row)


def _remark(row: RemarkRow) -> Remark:
    return from_row(Remark, row)
