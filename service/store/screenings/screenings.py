"""Reading and writing valves and screenings, within a session of the ``Store``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import ScalarSelect, Select, delete, exists, func, insert, select, update
from sqlalchemy.orm import InstrumentedAttribute, Session, aliased, undefer

from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.plant_path import LEVELS, levels_of
from stemwatch.service.presenter.cost_of_sticking import MADE_BY_STICKING
from stemwatch.service.presenter.work_decision import overall_verdict
from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.mismatch_json import mismatch_of
from stemwatch.service.store.screenings.named_effects import defective_column
from stemwatch.service.store.screenings.records import (
    DescribedValve,
    EarlierCurve,
    StoredScreening,
    StoredValve,
    TrendPoint,
)
from stemwatch.service.store.screenings.rows import (
    indicator_columns,
    screening_columns,
    stored_screening,
    stored_valve,
)
from stemwatch.service.store.screenings.tables import IndicatorRow, RunRow, ScreeningRow, ValveRow

CURVE = "stroke_curve"  # key in the JSON of a mismatch
_IN_ONE_STATEMENT = 500  # SQLite takes 32766 parameters


def write_screening(
    session: Session, screening: Screening, run_id: int, baseline_id: int | None = None
) -> int:
    """Write one screening with its indicators; replaces one of the same window."""
    run = session.get(RunRow, run_id)
    if run is None:
        raise StoreError(f"run {run_id} is not in the store; begin_run gives the number of one")
    ensure_valve(session, screening.valve)
    columns = screening_columns(screening, datetime.now(UTC)) | {
        "run_id": run_id,
        "software_version": run.software_version,
        "settings_digest": run.settings_digest,
        "baseline_id": baseline_id,
    }
    statement = upsert(
        session, ScreeningRow, [columns], ("valve", "window_key"), returning=ScreeningRow.id
    )
    screening_id: int = session.execute(statement).scalar_one()
    if columns["window_end"] is not None:
        _put_before(session, screening.valve, columns["at"], run_id)
    session.execute(delete(IndicatorRow).where(IndicatorRow.screening_id == screening_id))
    if indicators := indicator_columns(screening, screening_id, columns["at"]):
        session.execute(insert(IndicatorRow), indicators)
    return screening_id


def _put_before(session: Session, valve: str, at: datetime, run_id: int) -> None:
    """Put what an earlier run could not read before the window that ended ``at``, where that is the
    newest of its valve.

    What could not be read has no time but that of its run. An export that arrives after a run in
    vain ends before that run, and would else never be the latest that is known of the valve.
    """
    newer = aliased(ScreeningRow)
    of_valve = (newer.valve == valve, newer.window_end.is_not(None), newer.at > at)
    session.execute(
        update(ScreeningRow)
        .where(ScreeningRow.valve == valve, ScreeningRow.at >= at, ScreeningRow.run_id < run_id)
        .where(ScreeningRow.window_end.is_(None), ScreeningRow.layout == "")
        .where(~exists().where(*of_valve))
        .values(at=at - timedelta(microseconds=1))
    )


def ensure_valve(session: Session, valve: str) -> None:
    """Add a row for the valve where there is none; an existing one is not changed."""
    values = {"id": valve, "description": "", "criticality": 2, **dict.fromkeys(LEVELS, "")}
    session.execute(upsert(session, ValveRow, [values], ("id",), update=False))


def write_valves(session: Session, valves: Iterable[DescribedValve]) -> None:
    """Store the description of each valve; of several with one id the last one counts."""
    values = {
        valve.id: {
            "id": valve.id,
            "description": valve.description,
            "criticality": valve.criticality,
            **levels_of(valve),
        }
        for valve in valves
    }
    rows = [values[valve] for valve in sorted(values)]  # always in this order, against deadlocks
    for first in range(0, len(rows), _IN_ONE_STATEMENT):
        part = rows[first : first + _IN_ONE_STATEMENT]
        session.execute(upsert(session, ValveRow, part, ("id",)))


def read_valves(session: Session) -> list[StoredValve]:
    """Every valve, by id."""
    return [stored_valve(row) for row in session.scalars(select(ValveRow).order_by(ValveRow.id))]


def is_known(session: Session, valve: str) -> bool:
    """Whether there is a valve with this id."""
    return session.scalar(select(ValveRow.id).where(ValveRow.id == valve)) is not None


def read_valve(session: Session, valve: str) -> StoredValve | None:
    """The valve with this id."""
    row = session.get(ValveRow, valve)
    return None if row is None else stored_valve(row)


def read_curves(session: Session, valve: str, limit: int) -> list[EarlierCurve]:
    """The curves of the valve's last windows that have dates and were fitted, newest first."""
    table = ScreeningRow
    statement = (
        select(table.window_start, table.window_end, table.mismatch)
        .where(table.valve == valve, table.mismatch_finding != Finding.NOT_TESTABLE.value)
        .where(table.window_start.is_not(None), table.window_end.is_not(None))
        .order_by(table.at.desc(), table.id.desc())
        .limit(limit)
    )
    curves = []
    for start, end, stored in session.execute(statement):
        # Without this key an older version wrote the row, which did not look for a curve.
        mismatch = mismatch_of(stored) if CURVE in (stored or {}) else None
        if mismatch is not None:
            curves.append(EarlierCurve(start=start, end=end, curve=mismatch.stroke_curve))
    return curves


def read_last(session: Session, valve: str, limit: int) -> list[StoredScreening]:
    """The valve's last screenings, newest first."""
    rows = select(ScreeningRow).options(undefer(ScreeningRow.evidence))
    rows = rows.where(ScreeningRow.valve == valve)
    rows = rows.order_by(ScreeningRow.at.desc(), ScreeningRow.id.desc()).limit(limit)
    return [stored_screening(row) for row in session.scalars(rows)]


def read_indicator(session: Session, name: str, screenings: Sequence[int]) -> dict[int, float]:
    """One indicator of several screenings, by their numbers."""
    rows = select(IndicatorRow.screening_id, IndicatorRow.value).where(
        IndicatorRow.screening_id.in_(screenings), IndicatorRow.name == name
    )
    return {number: value for number, value in session.execute(rows) if value is not None}


def read_made_by_sticking(
    session: Session, valves: Sequence[str]
) -> dict[str, dict[str, TrendPoint]]:
    """What the sticking makes of the loop of each of ``valves``, as indicators of its latest
    screening."""
    by_valve: dict[str, dict[str, TrendPoint]] = {}
    for first in range(0, len(valves), _IN_ONE_STATEMENT):
        part = valves[first : first + _IN_ONE_STATEMENT]
        rows = (
            select(IndicatorRow)
            .join(ValveRow, ValveRow.id == IndicatorRow.valve)
            .where(
                ValveRow.id.in_(part),
                IndicatorRow.screening_id == latest_screening_id(),
                IndicatorRow.name.in_(MADE_BY_STICKING),
            )
        )
        for row in session.scalars(rows):
            by_valve.setdefault(row.valve, {})[row.name] = TrendPoint(
                at=row.at, value=row.value, low=row.low, high=row.high, unit=row.unit
            )
    return by_valve


def latest_screening_id(
    valve: InstrumentedAttribute[str] = ValveRow.id,
    before: int = 0,
    until: datetime | None = None,
) -> ScalarSelect[int]:
    """A subquery: the number of the latest screening of the valve in column ``valve`` of the outer
    query, or of the one ``before`` places earlier; NULL where there is none. With ``until`` the
    latest at that time.

    One index seek for each valve, so that the time does not grow with the years stored.
    """
    newest = aliased(ScreeningRow)
    return (
        select(newest.id)
        .where(newest.valve == valve, *(() if until is None else (newest.at <= until,)))
        .order_by(newest.at.desc(), newest.id.desc())
        .limit(1)
        .offset(before)
        .correlate(valve.parent)
        .scalar_subquery()
    )


def count_verdicts(session: Session, run_id: int) -> dict[str, int]:
    """How many of a run's screenings ended in each verdict on their valve."""
    return count_overall(session, select(ScreeningRow).where(ScreeningRow.run_id == run_id))


def count_overall(session: Session, query: Select[Any]) -> dict[str, int]:
    """How many of the screenings ``query`` ended in each verdict on their valve."""
    defective = defective_column()
    statement = query.with_only_columns(ScreeningRow.verdict, defective, func.count())
    grouped = statement.group_by(ScreeningRow.verdict, defective)
    counts: dict[str, int] = {}
    for word, named, count in session.execute(grouped):
        verdict = overall_verdict(Verdict(word), named=bool(named)).value
        counts[verdict] = counts.get(verdict, 0) + count
    return counts
