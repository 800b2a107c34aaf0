"""``stemwatch db prune``: remove samples, results, alerts and messages that are too old."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from sqlalchemy import ColumnElement, and_, delete, func, or_, select
from sqlalchemy.orm import Session, aliased

from stemwatch.service.store.alerts.tables import AlertRow, DeliveryRow
from stemwatch.service.store.database.columns import TableBase
from stemwatch.service.store.samples.partitions import DAY_US
from stemwatch.service.store.samples.tables import SampleRow, microseconds
from stemwatch.service.store.screenings.screenings import latest_screening_id
from stemwatch.service.store.screenings.tables import RunRow, ScreeningRow
from stemwatch.service.store.store import Store

MOST_DAYS = 36_600  # a century


@dataclass(frozen=True, kw_only=True)
class RetentionDays:
    """How many days to keep of each, 1 to ``MOST_DAYS``; ``None`` keeps everything. Raises
    ``ValueError`` for others."""

    samples_days: float | None = None
    results_days: float | None = None
    alerts_days: float | None = None

    def __post_init__(self) -> None:
        for days in (self.samples_days, self.results_days, self.alerts_days):
            if days is not None and not 1 <= days <= MOST_DAYS:
                raise ValueError(f"1 to {MOST_DAYS} days can be kept, received {days:g}")


@dataclass(frozen=True, kw_only=True)
class Pruned:
    """Rows that were removed or would be, by kind."""

    samples: int = 0
    screenings: int = 0
    runs: int = 0
    alerts: int = 0
    messages: int = 0

    @property
    def total(self) -> int:
        """The sum of all kinds."""
        return self.samples + self.screenings + self.runs + self.alerts + self.messages


def would_prune(store: Store, ages: RetentionDays, now: datetime | None = None) -> Pruned:
    """What ``prune`` would remove. Changes nothing. Raises ``StoreError``."""
    now = now or datetime.now(UTC)
    with store.transactions.reading("counting what is over age") as session:
        before_us = _samples_before_us(ages, now)
        samples = 0 if before_us is None else _count(session, SampleRow, _older(before_us))
        rules = _rules(ages, now)
        counts = {
            name: _count(session, table, rules[name])
            for name, table in _TABLES.items()
            if name in rules
        }
    return Pruned(samples=samples, **counts)


def prune(store: Store, ages: RetentionDays, now: datetime | None = None) -> Pruned:
    """Remove what is too old: whole days of samples; screenings with their indicators, but never a
    valve's latest; runs without screenings; closed alerts; messages that were sent or given up.
    Baselines, notes and maintenance are kept. Raises ``StoreError``."""
    now = now or datetime.now(UTC)
    samples = 0
    if ages.samples_days is not None:
        oldest = now - timedelta(days=ages.samples_days)
        samples = store.samples.remove_before(oldest, whole_days=True)
    removed: dict[str, int] = {}
    with store.transactions.writing("removing what is over age") as session:
        for name, rule in _rules(ages, now).items():
            deleted = session.execute(
                delete(_TABLES[name]).where(rule), execution_options={"synchronize_session": False}
            )
            removed[name] = deleted.rowcount  # type: ignore[attr-defined]  # a DELETE has one
    return Pruned(samples=samples, **removed)


# Screenings before runs: a run can be removed only after its screenings.
_TABLES: dict[str, type[TableBase]] = {
    "screenings": ScreeningRow,
    "runs": RunRow,
    "alerts": AlertRow,
    "messages": DeliveryRow,
}


def _rules(ages: RetentionDays, now: datetime) -> dict[str, ColumnElement[bool]]:
    rules: dict[str, ColumnElement[bool]] = {}
    if ages.results_days is not None:
        before = now - timedelta(days=ages.results_days)
        rules["screenings"] = _old_screenings(before)
        rules["runs"] = _empty_runs(before)
    if ages.alerts_days is not None:
        before = now - timedelta(days=ages.alerts_days)
        rules["alerts"] = and_(AlertRow.closed.is_not(None), AlertRow.closed < before)
        settled = or_(DeliveryRow.sent.is_not(None), DeliveryRow.given_up)
        rules["messages"] = and_(settled, DeliveryRow.created < before)
    return rules


def _old_screenings(before: datetime) -> ColumnElement[bool]:
    newest = latest_screening_id(ScreeningRow.valve)
    return and_(ScreeningRow.at < before, ScreeningRow.id != newest)


def _empty_runs(before: datetime) -> ColumnElement[bool]:
    """Runs that are over and have no screenings, or only ones that this pruning removes."""
    screening = aliased(ScreeningRow)
    newest = latest_screening_id(screening.valve)
    kept_screenings = select(screening.id).where(
        screening.run_id == RunRow.id, or_(screening.at >= before, screening.id == newest)
    )
    return and_(RunRow.finished.is_not(None), RunRow.finished < before, ~kept_screenings.exists())


def _samples_before_us(ages: RetentionDays, now: datetime) -> int | None:
    if ages.samples_days is None:
        return None
    before_us = microseconds(now - timedelta(days=ages.samples_days))
    return before_us - before_us % DAY_US


def _older(before_us: int) -> ColumnElement[bool]:
    return SampleRow.at_us < before_us


def _count(session: Session, table: type[TableBase], rule: ColumnElement[bool]) -> int:
    return session.scalar(select(func.count()).select_from(table).where(rule)) or 0
