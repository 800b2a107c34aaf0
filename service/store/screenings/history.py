"""One valve over time: S and J of its screenings, its baselines, the indicators of a screening."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import select
from sqlalchemy.orm import Session

from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.work_decision import overall_verdict
from stemwatch.service.store.screenings.baselines import BASELINE
from stemwatch.service.store.screenings.named_effects import standing_columns, standing_defects
from stemwatch.service.store.screenings.records import TrendPoint
from stemwatch.service.store.screenings.tables import (
    IndicatorRow,
    NetworkRow,
    ScreeningRow,
)

MOST_POINTS = 3000


@dataclass(frozen=True, kw_only=True)
class HistoryPoint:
    """S and J of one screening, each (value, low, high) in percent of OP span, and the verdict on
    its valve."""

    id: int
    at: datetime
    verdict: Verdict
    S: tuple[float | None, float | None, float | None]
    J: tuple[float | None, float | None, float | None]
    severity: float
    grade: str
    run: int
    baseline: int | None


@dataclass(frozen=True, kw_only=True)
class BaselineMark:
    """A present or former baseline without its network. ``at`` is the end of its window."""

    id: int
    at: datetime
    window: tuple[datetime | None, datetime | None]
    created: datetime
    reason: str
    active: bool


def read_indicators(session: Session, screening: int) -> Mapping[str, TrendPoint]:
    """The indicators of one screening, by name."""
    rows = select(IndicatorRow).where(IndicatorRow.screening_id == screening)
    return {
        row.name: TrendPoint(at=row.at, value=row.value, low=row.low, high=row.high, unit=row.unit)
        for row in session.scalars(rows.order_by(IndicatorRow.name))
    }


def read_history(session: Session, valve: str, since: datetime | None = None) -> list[HistoryPoint]:
    """S and J over time, oldest first; the newest ``MOST_POINTS`` of them."""
    table = ScreeningRow
    columns = (
        table.id,
        table.at,
        table.verdict,
        table.mismatch_slugs,
        *standing_columns(),
        table.severity,
        table.grade,
        table.run_id,
        table.baseline_id,
    )
    S = (table.s_percent, table.s_low_percent, table.s_high_percent)
    J = (table.j_percent, table.j_low_percent, table.j_high_percent)
    statement = select(*columns, *S, *J).where(table.valve == valve)
    if since is not None:
        statement = statement.where(table.at >= since)
    rows = session.execute(statement.order_by(table.at.desc(), table.id.desc()).limit(MOST_POINTS))
    points = [
        HistoryPoint(
            id=row.id,
            at=row.at,
            verdict=overall_verdict(Verdict(row.verdict), named=bool(standing_defects(row))),
            S=(row.s_percent, row.s_low_percent, row.s_high_percent),
            J=(row.j_percent, row.j_low_percent, row.j_high_percent),
            severity=row.severity,
            grade=row.grade,
            run=row.run_id,
            baseline=row.baseline_id,
        )
        for row in rows
    ]
    return points[::-1]


def read_baseline_marks(session: Session, valve: str) -> list[BaselineMark]:
    """Every baseline of the valve, oldest first."""
    network = NetworkRow
    columns = (
        network.id,
        network.window_start,
        network.window_end,
        network.created,
        network.reason,
        network.active,
    )
    statement = select(*columns).where(network.valve == valve, network.kind == BASELINE)
    return [
        BaselineMark(
            id=row.id,
            at=row.window_end or row.created,
            window=(row.window_start, row.window_end),
            created=row.created,
            reason=row.reason,
            active=row.active,
        )
        for row in session.execute(statement.order_by(network.id))
    ]
