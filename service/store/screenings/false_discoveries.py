"""False-discovery control over a run, as stored: p values of its screenings, and remarks.

Which effects stand is decided in ``service.run.finish``. A screening whose named effects do not
stand gets a remark, stored as one more key in the JSON of its mismatch; where the valve has a
history, what its windows confirm is one more key in the JSON of its evidence. Neither is changed
otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import JSON, select, type_coerce
from sqlalchemy.orm import Session, undefer

from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.store.screenings.named_effects import (
    CONFIRMED,
    HELD_BACK,
    confirmed_column,
    defects_column,
    defects_of,
)
from stemwatch.service.store.screenings.tables import ScreeningRow


@dataclass(frozen=True, kw_only=True)
class TestedScreening:
    """A screening that could have shown an effect: its p value, ``None`` where none was named;
    ``defects``: some of what it names is to be mended."""

    screening: int
    valve: str
    p_value: float | None
    named: bool
    defects: bool = False


@dataclass(frozen=True, kw_only=True)
class StandingMark:
    """What is kept of a screening once all valves of its run are known: why what it names does not
    stand (``held_back``, empty where it does), and the slugs that the windows of weeks confirm,
    ``None`` where the valve has no history that decides."""

    held_back: str = ""
    confirmed: tuple[str, ...] | None = None


def read_tested(session: Session, run_id: int) -> list[TestedScreening]:
    """The screenings of a run in which an effect could have been found, sorted by number."""
    p_value = type_coerce(ScreeningRow.mismatch, JSON)["p_value"].as_float()
    rows = (
        select(
            ScreeningRow.id,
            ScreeningRow.valve,
            ScreeningRow.mismatch_slugs,
            p_value,
            defects_column(),
        )
        .where(
            ScreeningRow.run_id == run_id,
            ScreeningRow.mismatch_finding.is_not(None),
            ScreeningRow.mismatch_finding != Finding.NOT_TESTABLE.value,
        )
        .order_by(ScreeningRow.id)
    )
    return [
        TestedScreening(
            screening=number,
            valve=valve,
            p_value=p if slugs else None,
            named=bool(slugs),
            defects=bool(defects_of(slugs, defects)),
        )
        for number, valve, slugs, p, defects in session.execute(rows)
    ]


def read_confirmed(session: Session, run_id: int) -> set[str]:
    """The valves of a run on which the windows of weeks confirm an effect that stands."""
    rows = select(ScreeningRow.valve).where(ScreeningRow.run_id == run_id)
    return set(session.scalars(rows.where(confirmed_column() != "")))


def write_marks(session: Session, marks: Mapping[int, StandingMark]) -> None:
    """Write what changed, by screening number, and remove what is no longer so."""
    rows = select(ScreeningRow).options(undefer(ScreeningRow.evidence))
    rows = rows.where(ScreeningRow.id.in_(list(marks))).with_for_update()
    for row in session.scalars(rows):
        mark = marks[row.id]
        confirmed = None if mark.confirmed is None else " ".join(mark.confirmed)
        row.mismatch = _with_key(row.mismatch, HELD_BACK, mark.held_back or None)
        row.evidence = _with_key(row.evidence, CONFIRMED, confirmed)


def _with_key(kept: dict[str, Any] | None, key: str, value: str | None) -> dict[str, Any] | None:
    """``kept`` with ``key`` at ``value``, without it for ``None``; the same object if that is so
    already, which then is not written."""
    if kept is None or kept.get(key) == value:
        return kept
    rest = {name: old for name, old in kept.items() if name != key}
    return rest if value is None else rest | {key: value}
