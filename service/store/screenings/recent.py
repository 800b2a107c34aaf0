"""The last screenings of many valves at once, in a few queries whose time does not grow with the
number of stored screenings."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import and_, case, select
from sqlalchemy.orm import Session

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.recording import PERCENT
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.store.screenings.baselines import BASELINE
from stemwatch.service.store.screenings.mismatch_json import mismatch_of
from stemwatch.service.store.screenings.named_effects import standing_columns, standing_defects
from stemwatch.service.store.screenings.records import JudgedScreening, RecentOfValve
from stemwatch.service.store.screenings.rows import without_position_of
from stemwatch.service.store.screenings.screenings import latest_screening_id, read_indicator
from stemwatch.service.store.screenings.tables import (
    MaintenanceRow,
    NetworkRow,
    NoteRow,
    ScreeningRow,
    ValveRow,
)

_NAMED = Finding.NAMED.value
_COLUMNS = (
    ScreeningRow.id,
    ScreeningRow.valve,
    ScreeningRow.run_id,
    ScreeningRow.window_start,
    ScreeningRow.window_end,
    ScreeningRow.verdict,
    ScreeningRow.shape,
    ScreeningRow.reason,
    ScreeningRow.advice,
    ScreeningRow.severity,
    ScreeningRow.s_percent,
    ScreeningRow.s_low_percent,
    ScreeningRow.s_high_percent,
    ScreeningRow.s_reason,
    ScreeningRow.j_percent,
    ScreeningRow.mismatch_finding,
    ScreeningRow.mismatch_slugs,
    *standing_columns(),
    case((ScreeningRow.verdict == Verdict.UNDETERMINED.value, ScreeningRow.without_position)).label(
        "suspicion"
    ),
)


def read_recent(
    session: Session, valves: Sequence[str], depth: int, indicator: str
) -> dict[str, RecentOfValve]:
    """The last ``depth`` screenings of each of ``valves``; at most a few hundred valves at a time,
    since one statement names them all."""
    judged = _last(session, valves, depth)
    at_baseline = _at_baseline(session, valves)
    numbers = [screening.id for screenings in judged.values() for screening in screenings]
    values = read_indicator(session, indicator, numbers)
    worked_at = _worked_at(session, valves)
    return {
        valve: RecentOfValve(
            screenings=(of_valve := judged.get(valve, [])),
            at_baseline=at_baseline.get(valve),
            indicator={judged.id: values[judged.id] for judged in of_valve if judged.id in values},
            worked_at=worked_at.get(valve, ()),
        )
        for valve in valves
    }


def read_work_without_note(session: Session, valves: Sequence[str], writer: str) -> list[str]:
    """Those of ``valves`` whose last maintenance has no note by ``writer`` at its instant."""
    work = select(MaintenanceRow.valve, MaintenanceRow.at).order_by(MaintenanceRow.at)
    rows = session.execute(work.where(MaintenanceRow.valve.in_(valves)))
    last = {
        valve: worked_at for valve, worked_at in rows
    }  # rows are in order of time: the last one remains
    notes = select(NoteRow.valve, NoteRow.at).where(
        NoteRow.who == writer, NoteRow.valve.in_(list(last))
    )
    with_note = (
        {(valve, worked_at) for valve, worked_at in session.execute(notes)} if last else set()
    )
    return [valve for valve in valves if valve in last and (valve, last[valve]) not in with_note]


def _worked_at(session: Session, valves: Sequence[str]) -> dict[str, list[datetime]]:
    """The instants of maintenance of each of ``valves`` that has any."""
    worked: dict[str, list[datetime]] = {}
    work = select(MaintenanceRow.valve, MaintenanceRow.at).where(MaintenanceRow.valve.in_(valves))
    for valve, worked_at in session.execute(work):
        worked.setdefault(valve, []).append(worked_at)
    return worked


def _last(session: Session, valves: Sequence[str], depth: int) -> dict[str, list[JudgedScreening]]:
    """The last ``depth`` screenings of each valve, newest first.

    Their numbers come from one index seek each, so that the time does not grow with the years
    stored; the mismatch is read for the newest one only.
    """
    seeks = [latest_screening_id(before=n).label(f"back_{n}") for n in range(depth)]
    ids_of = session.execute(select(ValveRow.id, *seeks).where(ValveRow.id.in_(valves)))
    order = {valve: [number for number in ids if number is not None] for valve, *ids in ids_of}
    numbers = [number for ids in order.values() for number in ids]
    rows = select(*_COLUMNS).where(ScreeningRow.id.in_(numbers))
    by_number = {row.id: row for row in session.execute(rows)}
    counts = {
        valve: [by_number[number] for number in ids if number in by_number]
        for valve, ids in order.items()
    }
    named = _named(session, [newest for rows in counts.values() if (newest := _newest(rows))])
    return {
        valve: [_judged(row, named.get(row.id)) for row in rows] for valve, rows in counts.items()
    }


def _newest(rows: Sequence[Any]) -> int | None:
    """The number of the newest screening with a verdict, if it names an effect."""
    for row in rows:
        if row.verdict != Verdict.UNDETERMINED.value:
            return int(row.id) if row.mismatch_finding == _NAMED else None
    return None


def _named(session: Session, numbers: Sequence[int]) -> dict[int, Mismatch]:
    if not numbers:
        return {}
    rows = select(ScreeningRow.id, ScreeningRow.mismatch).where(ScreeningRow.id.in_(numbers))
    read = ((number, mismatch_of(stored)) for number, stored in session.execute(rows))
    return {number: mismatch for number, mismatch in read if mismatch is not None}


def _judged(row: Any, mismatch: Mismatch | None) -> JudgedScreening:
    return JudgedScreening(
        id=row.id,
        run_id=row.run_id,
        window=(row.window_start, row.window_end),
        verdict=Verdict(row.verdict),
        reason=row.reason,
        advice=row.advice,
        severity=row.severity,
        S=_percent(row),
        J=row.j_percent,
        shape=None if row.shape is None else Shape(row.shape),
        named=row.mismatch_finding == _NAMED and bool(standing_defects(row)),
        mismatch=mismatch,
        without_position=without_position_of(row.suspicion),
    )


def _percent(row: Any) -> Estimate:
    return Estimate(
        value=row.s_percent,
        low=row.s_low_percent,
        high=row.s_high_percent,
        unit=PERCENT,
        reason=row.s_reason,
    )


def _at_baseline(session: Session, valves: Sequence[str]) -> dict[str, Estimate]:
    """S in the window that each valve's baseline was fitted to."""
    same_baseline = and_(
        ScreeningRow.valve == NetworkRow.valve,
        ScreeningRow.at == NetworkRow.window_end,  # has an index; it is the end of the window
        ScreeningRow.window_end == NetworkRow.window_end,
        ScreeningRow.window_start == NetworkRow.window_start,
    )
    columns = (
        ScreeningRow.valve,
        ScreeningRow.s_percent,
        ScreeningRow.s_low_percent,
        ScreeningRow.s_high_percent,
        ScreeningRow.s_reason,
    )
    rows = select(*columns).select_from(NetworkRow).join(ScreeningRow, same_baseline)
    rows = rows.where(NetworkRow.valve.in_(valves), NetworkRow.kind == BASELINE, NetworkRow.active)
    return {row.valve: _percent(row) for row in session.execute(rows)}
