"""What is kept of windows for their pictures, packed by the report: of one, and around work on a
valve."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import ColumnElement, and_, delete, select, true
from sqlalchemy.orm import Session

from stemwatch.service.store.screenings.records import Remark
from stemwatch.service.store.screenings.tables import MaintenanceRow, PictureRow, ScreeningRow

MOST_WORK = 10  # maintenance of a valve that is looked at, the newest first


@dataclass(frozen=True, kw_only=True)
class PicturedWindow:
    """A window with its packed pictures; S and J in percent of OP span, ``None`` if not known."""

    end: datetime
    S: float | None
    J: float | None
    packed: bytes


@dataclass(frozen=True, kw_only=True)
class AroundWork:
    """The last work on a valve that has a window before and one after it: what was done, the window
    that ended last before it, and the latest that began after it."""

    work: Remark
    before: PicturedWindow
    after: PicturedWindow


def write_pictures(session: Session, screening: int, packed: bytes) -> None:
    """Keep the pictures of a screening instead of any that it had."""
    session.execute(delete(PictureRow).where(PictureRow.screening_id == screening))
    if packed:
        session.add(PictureRow(screening_id=screening, packed=packed))


def read_pictures(session: Session, screening: int) -> bytes:
    """The packed pictures of a screening; empty where none are kept."""
    packed = select(PictureRow.packed).where(PictureRow.screening_id == screening)
    return session.scalar(packed) or b""


def read_around_work(
    session: Session, valve: str, until_run: int | None = None
) -> AroundWork | None:
    """The last work on ``valve`` between two windows, none of them of a run after ``until_run``;
    ``None`` where there is none."""
    until_then = true() if until_run is None else ScreeningRow.run_id <= until_run
    work_query = select(MaintenanceRow).where(MaintenanceRow.valve == valve)
    work_query = work_query.order_by(MaintenanceRow.at.desc(), MaintenanceRow.id.desc())
    for work in session.scalars(work_query.limit(MOST_WORK)):
        after = _latest(session, valve, and_(ScreeningRow.window_start >= work.at, until_then))
        ended = and_(ScreeningRow.window_end <= work.at, until_then)
        before = after and _latest(session, valve, ended)
        if before and after:
            work_done = Remark(valve=valve, at=work.at, note=work.note, who=work.who)
            return AroundWork(work=work_done, before=before, after=after)
    return None


def read_work_compared(
    session: Session, valves: Collection[str], until_run: int | None = None
) -> list[AroundWork]:
    """``read_around_work`` of each of ``valves`` that has it."""
    worked = session.scalars(select(MaintenanceRow.valve).distinct())
    compared = (
        read_around_work(session, valve, until_run) for valve in sorted(set(worked) & set(valves))
    )
    return [around for around in compared if around is not None]


def _latest(session: Session, valve: str, when: ColumnElement[bool]) -> PicturedWindow | None:
    table = ScreeningRow
    rows = (
        select(table.at, table.s_percent, table.j_percent, PictureRow.packed)
        .join(PictureRow, PictureRow.screening_id == table.id)
        .where(table.valve == valve, when)
        .order_by(table.at.desc(), table.id.desc())
        .limit(1)
    )
    for end, S, J, packed in session.execute(rows):
        return PicturedWindow(end=end, S=S, J=J, packed=packed)
    return None
