"""False-discovery control over a run, as stored: p values of its screenings, and remarks.

Which effects stand is decided in ``service.run.finish``. A screening whose named effects do not
stand gets a remark, stored as one more key in the JSON of its mismatch, which is not changed
otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import JSON, ColumnElement, case, select, type_coerce
from sqlalchemy.orm import Session

from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.store.screenings.tables import ScreeningRow

KEY = "held_back"


@dataclass(frozen=True, kw_only=True)
class TestedScreening:
    """A screening that could have shown an effect: its p value, ``None`` where none was named."""

    screening: int
    valve: str
    p_value: float | None
    named: bool


def remark_column(of: Any = ScreeningRow) -> ColumnElement[str | None]:
    """The remark as an SQL column, read only for screenings with named effects, since the JSON is
    long; NULL where there is none. ``of`` is the table of screenings or an alias of it."""
    stored_remark = type_coerce(of.mismatch, JSON)[KEY].as_string()
    named = of.mismatch_finding.in_([Finding.NAMED.value, Finding.CANDIDATES.value])
    return case((named, stored_remark), else_=None).label(KEY)


def remark_of(stored: Any) -> str:
    """The remark in a stored mismatch; empty where the effects stand or nothing was named."""
    text = stored.get(KEY) if isinstance(stored, dict) else None
    return text if isinstance(text, str) else ""


def read_tested(session: Session, run_id: int) -> list[TestedScreening]:
    """The screenings of a run in which an effect could have been found, sorted by number."""
    p_value = type_coerce(ScreeningRow.mismatch, JSON)["p_value"].as_float()
    rows = (
        select(ScreeningRow.id, ScreeningRow.valve, ScreeningRow.mismatch_slugs, p_value)
        .where(
            ScreeningRow.run_id == run_id,
            ScreeningRow.mismatch_finding.is_not(None),
            ScreeningRow.mismatch_finding != Finding.NOT_TESTABLE.value,
        )
        .order_by(ScreeningRow.id)
    )
    return [
        TestedScreening(
            screening=number, valve=valve, p_value=p if slugs else None, named=bool(slugs)
        )
        for number, valve, slugs, p in session.execute(rows)
    ]


def write_remarks(session: Session, marks: Mapping[int, str]) -> None:
    """Write new remarks, and remove those that are now empty."""
    rows = select(ScreeningRow).where(ScreeningRow.id.in_(list(marks))).with_for_update()
    for row in session.scalars(rows):
        stored_mismatch = row.mismatch
        if stored_mismatch is None or stored_mismatch.get(KEY, "") == marks[row.id]:
            continue
        without_remark = {key: value for key, value in stored_mismatch.items() if key != KEY}
        row.mismatch = without_remark | ({KEY: marks[row.id]} if marks[row.id] else {})
