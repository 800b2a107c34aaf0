"""The previous result of a valve, for trends, "since when" and the ranking.

A screening is earlier if it is of another window and its instant ``at`` is before. Where the source
has no dates, ``at`` is the time of saving; reading the same source again gives the same window.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from sqlalchemy import and_, select
from sqlalchemy.orm import Session, aliased

from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.store.screenings.named_effects import standing_columns, standing_defects
from stemwatch.service.store.screenings.rows import window_key
from stemwatch.service.store.screenings.tables import ScreeningRow


def read_previous(
    session: Session, screening: Screening, limit: int, now: datetime | None = None
) -> list[PreviousFinding]:
    """The results before ``screening``, newest first, at most ``limit``.

    "Before" refers to the end of its window; without dates to ``now``, and without ``now`` to the
    time at which it was saved itself.
    """
    table = ScreeningRow
    key = window_key(screening)
    before = screening.window[1] or now
    if before is None:
        conditions = select(table.at).where(table.valve == screening.valve, table.window_key == key)
        before = session.scalar(conditions)
    statement = select(*_columns(table)).where(
        table.valve == screening.valve, table.window_key != key
    )
    if before is not None:
        statement = statement.where(table.at < before)
    rows = session.execute(statement.order_by(table.at.desc(), table.id.desc()).limit(limit))
    return [_previous(row) for row in rows]


def read_previous_of(session: Session, screenings: Sequence[int]) -> dict[int, PreviousFinding]:
    """The previous result of each of these screenings, by number, in one statement for a page of
    valves; those without an earlier one are left out."""
    if not screenings:
        return {}
    now, before, inner = aliased(ScreeningRow), aliased(ScreeningRow), aliased(ScreeningRow)
    earlier = (
        select(inner.id)
        .where(inner.valve == now.valve, inner.at < now.at)
        .order_by(inner.at.desc(), inner.id.desc())
        .limit(1)
        .correlate(now)
        .scalar_subquery()
    )
    statement = select(now.id.label("of"), *_columns(before)).join(
        before, and_(before.valve == now.valve, before.id == earlier)
    )
    rows = session.execute(statement.where(now.id.in_(screenings)))
    return {row.of: _previous(row) for row in rows}


def _columns(screening: Any) -> tuple[Any, ...]:
    numbers = (screening.severity, screening.s_percent, screening.j_percent)
    return (
        screening.at,
        screening.run_id,
        screening.verdict,
        *numbers,
        screening.mismatch_finding,
        screening.mismatch_slugs,
        *standing_columns(screening),
    )


def _previous(row: Any) -> PreviousFinding:
    defects = standing_defects(row)
    return PreviousFinding(
        at=row.at,
        run=row.run_id,
        verdict=Verdict(row.verdict),
        severity=row.severity,
        S=row.s_percent,
        J=row.j_percent,
        finding=row.mismatch_finding,
        effects=tuple(dict.fromkeys((*(row.mismatch_slugs or ()), *defects))),
        defects=defects,
    )
