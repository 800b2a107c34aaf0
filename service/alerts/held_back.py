"""Which of a run's named effects stand, over all its valves: marked in the store, once.

Among many valves chance alone names something on a few (``report.discoveries``). What does not
stand is marked in the screening itself, so that rules, pages and reports agree about it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqlalchemy import JSON, select, type_coerce
from sqlalchemy.orm import Session

from stemwatch.models.false_discovery import significant
from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.presenter.false_discoveries import Discoveries
from stemwatch.service.store.screenings.held_back import KEY as KEY
from stemwatch.service.store.screenings.tables import ScreeningRow
from stemwatch.service.store.store import Store


@dataclass(frozen=True, kw_only=True)
class Tested:
    """A screening that could have shown an effect: its p value, ``None`` where none was named."""

    screening: int
    valve: str
    p_value: float | None
    named: bool


def hold_back(store: Store, run_id: int) -> list[Tested]:
    """Mark what ``run_id`` named and what does not stand among its valves; all that was tested.

    Doing it again changes nothing. Raises ``StoreError``.
    """
    with store.access.reading() as session:
        found = _tested(session, run_id)
    stood = significant([one.p_value for one in found])
    named = sum(one.named and stand for one, stand in zip(found, stood, strict=True))
    held = [
        one.screening for one, stand in zip(found, stood, strict=True) if one.named and not stand
    ]
    remark = Discoveries(standing=(), tested=len(found), named=named, held_back=len(held)).remark
    marks = {
        one.screening: remark if one.screening in set(held) else "" for one in found if one.named
    }
    if marks:
        with store.access.writing(f"marking what run {run_id} found") as session:
            _mark(session, marks)
    return found


def p_elsewhere(found: Sequence[Tested], shown: Sequence[str]) -> tuple[float | None, ...]:
    """The p values of the valves that a report of ``shown`` leaves out."""
    there = set(shown)
    return tuple(one.p_value for one in found if one.valve not in there)


def _tested(session: Session, run_id: int) -> list[Tested]:
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
        Tested(screening=number, valve=valve, p_value=p if slugs else None, named=bool(slugs))
        for number, valve, slugs, p in session.execute(rows)
    ]


def _mark(session: Session, marks: dict[int, str]) -> None:
    """Write the remarks that are not there yet, and take away those that no longer hold."""
    rows = select(ScreeningRow).where(ScreeningRow.id.in_(list(marks))).with_for_update()
    for row in session.scalars(rows):
        kept = row.mismatch
        if kept is None or kept.get(KEY, "") == marks[row.id]:
            continue
        rest = {key: value for key, value in kept.items() if key != KEY}
        row.mismatch = rest | ({KEY: marks[row.id]} if marks[row.id] else {})
