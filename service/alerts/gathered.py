"""What the rules look at, for many valves at once: a few queries for hundreds of valves, and of
each valve's years no more than the last screenings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import and_, select
from sqlalchemy.orm import Session

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.recording import PERCENT
from stemwatch.models.verdict import Verdict
from stemwatch.service.alerts.after_maintenance import WRITER
from stemwatch.service.alerts.rules import RATIO, JudgedScreening, ValveRecord
from stemwatch.service.config import Plant
from stemwatch.service.store.screenings.baselines import BASELINE
from stemwatch.service.store.screenings.held_back import remark_column
from stemwatch.service.store.screenings.mismatch_json import mismatch_of
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.screenings.screenings import latest_screening_id
from stemwatch.service.store.screenings.tables import (
    IndicatorRow,
    MaintenanceRow,
    NetworkRow,
    NoteRow,
    ScreeningRow,
    ValveRow,
)
from stemwatch.service.store.store import Store

AT_ONCE = 250  # valves of one round of queries; times the depth, what one statement may name
_NAMED = Finding.NAMED.value
_COLUMNS = (
    ScreeningRow.id,
    ScreeningRow.valve,
    ScreeningRow.run_id,
    ScreeningRow.window_start,
    ScreeningRow.window_end,
    ScreeningRow.verdict,
    ScreeningRow.advice,
    ScreeningRow.severity,
    ScreeningRow.s_percent,
    ScreeningRow.s_low_percent,
    ScreeningRow.s_high_percent,
    ScreeningRow.s_reason,
    ScreeningRow.j_percent,
    ScreeningRow.mismatch_finding,
    remark_column(),
)


def gathered(store: Store, plant: Plant, valves: Sequence[str]) -> Iterator[ValveRecord]:
    """What is known of each of ``valves``, in their order. Raises ``StoreError``."""
    depth = max(plant.alerts.of_runs, plant.alerts.clear_after_runs) * 3
    for first in range(0, len(valves), AT_ONCE):
        part = valves[first : first + AT_ONCE]
        with store.access.reading() as session:
            judged = _last(session, part, depth)
            before = _at_baseline(session, part)
            numbers = [one.id for many in judged.values() for one in many]
            ratios = _ratios(session, numbers)
            worked_at = _worked_at(session, part)
        for valve in part:
            many = judged.get(valve, [])
            yield ValveRecord(
                valve=_facts(plant, valve),
                screenings=many,
                at_baseline=before.get(valve),
                ratios={one.id: ratios[one.id] for one in many if one.id in ratios},
                ratio_limit=plant.limits.baseline_ratio_watch,
                worked_at=worked_at.get(valve, ()),
            )


def _worked_at(session: Session, valves: Sequence[str]) -> dict[str, list[datetime]]:
    """When each of ``valves`` was worked on, where it was."""
    found: dict[str, list[datetime]] = {}
    work = select(MaintenanceRow.valve, MaintenanceRow.at).where(MaintenanceRow.valve.in_(valves))
    for valve, at in session.execute(work):
        found.setdefault(valve, []).append(at)
    return found


def awaiting_aftermath(store: Store, valves: Sequence[str]) -> list[str]:
    """Those of ``valves`` whose last maintenance no note compares with what followed yet."""
    found: list[str] = []
    for first in range(0, len(valves), AT_ONCE):
        part = valves[first : first + AT_ONCE]
        with store.access.reading() as session:
            work = select(MaintenanceRow.valve, MaintenanceRow.at).order_by(MaintenanceRow.at)
            rows = session.execute(work.where(MaintenanceRow.valve.in_(part)))
            last = {valve: at for valve, at in rows}  # of several the last one stays
            notes = select(NoteRow.valve, NoteRow.at).where(
                NoteRow.who == WRITER, NoteRow.valve.in_(list(last))
            )
            said = {(valve, at) for valve, at in session.execute(notes)} if last else set()
        found += [valve for valve in part if valve in last and (valve, last[valve]) not in said]
    return found


def _facts(plant: Plant, valve: str) -> StoredValve:
    entry = plant.valves.get(valve)
    if entry is None:
        return StoredValve(id=valve)
    return StoredValve(
        id=valve,
        description=entry.description,
        area=entry.area,
        criticality=entry.criticality,
    )


def _last(session: Session, valves: Sequence[str], depth: int) -> dict[str, list[JudgedScreening]]:
    """The last ``depth`` screenings of each valve, newest first.

    Their numbers come from the index, one short look for each, so that the time does not grow with
    the years stored; what they name is read of the newest alone.
    """
    looks = [latest_screening_id(before=n).label(f"back_{n}") for n in range(depth)]
    found = session.execute(select(ValveRow.id, *looks).where(ValveRow.id.in_(valves)))
    order = {valve: [one for one in ids if one is not None] for valve, *ids in found}
    numbers = [one for ids in order.values() for one in ids]
    rows = select(*_COLUMNS).where(ScreeningRow.id.in_(numbers))
    by_number = {row.id: row for row in session.execute(rows)}
    many = {
        valve: [by_number[one] for one in ids if one in by_number] for valve, ids in order.items()
    }
    named = _named(session, [newest for rows in many.values() if (newest := _newest(rows))])
    return {
        valve: [_judged(row, named.get(row.id)) for row in rows] for valve, rows in many.items()
    }


def _newest(rows: Sequence[Any]) -> int | None:
    """The newest screening with a verdict, where it names something."""
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
        advice=row.advice,
        severity=row.severity,
        S=_percent(row),
        J=row.j_percent,
        named=row.mismatch_finding == _NAMED and not row.held_back,
        mismatch=mismatch,
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
    same = and_(
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
    rows = select(*columns).select_from(NetworkRow).join(ScreeningRow, same)
    rows = rows.where(NetworkRow.valve.in_(valves), NetworkRow.kind == BASELINE, NetworkRow.active)
    return {row.valve: _percent(row) for row in session.execute(rows)}


def _ratios(session: Session, numbers: Sequence[int]) -> Mapping[int, float]:
    """The baseline ratio of each of these screenings that has one."""
    rows = select(IndicatorRow.screening_id, IndicatorRow.value).where(
        IndicatorRow.screening_id.in_(numbers), IndicatorRow.name == RATIO
    )
    return {number: value for number, value in session.execute(rows) if value is not None}
