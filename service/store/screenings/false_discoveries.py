"""What is stored of false-discovery control over a run.

Which screenings could have shown an effect, and the remark beside one whose named effects do not
stand among all valves of its run. Which of them stand is decided in ``alerts.held_back``. The
remark is a key beside the fields of the mismatch in its JSON column: what was found stays as it was
found.
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
    """The sentence in SQL, without the rest of the long column, and of the few that are named only;
    null where there is none. ``of`` is the table of screenings or an alias of it."""
    kept = type_coerce(of.mismatch, JSON)[KEY].as_string()
    named = of.mismatch_finding.in_([Finding.NAMED.value, Finding.CANDIDATES.value])
    return case((named, kept), else_=None).label(KEY)


def remark_of(stored: Any) -> str:
    """The sentence that says so; empty where the effects stand, or where nothing was named."""
    said = stored.get(KEY) if isinstance(stored, dict) else None
    return said if isinstance(said, str) else ""


def read_tested(session: Session, run_id: int) -> list[TestedScreening]:
    """The screenings of a run that could have shown an effect, by their numbers."""
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
    """Write the remarks that are not there yet, and take away those that no longer hold."""
    rows = select(ScreeningRow).where(ScreeningRow.id.in_(list(marks))).with_for_update()
    for row in session.scalars(rows):
        kept = row.mismatch
        if kept is None or kept.get(KEY, "") == marks[row.id]:
            continue
        rest = {key: value for key, value in kept.items() if key != KEY}
        row.mismatch = rest | ({KEY: marks[row.id]} if marks[row.id] else {})
