"""The tables. Times are UTC, numbers carry their unit in the name, and the migrations agree."""

from __future__ import annotations

from datetime import datetime
from typing import Any, ClassVar

from sqlalchemy import Double, ForeignKey, Index, LargeBinary, MetaData, UniqueConstraint, text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from stemwatch.service.store.columns import CleanJson, CleanText, UtcDateTime

_NAMES = {
    "ix": "ix_%(column_0_N_label)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "fk": "fk_%(table_name)s_%(column_0_N_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}


class Base(DeclarativeBase):
    """Constraint names are fixed here, so that migrations can drop what they created."""

    metadata = MetaData(naming_convention=_NAMES)
    type_annotation_map: ClassVar[dict[Any, Any]] = {
        str: CleanText,
        float: Double,
        datetime: UtcDateTime,
        dict[str, Any]: CleanJson,
        list[str]: CleanJson,
        bytes: LargeBinary,
    }


def _of_valve() -> Mapped[str]:
    return mapped_column(ForeignKey("valves.id", ondelete="CASCADE"))


class ValveRow(Base):
    """A valve and what the plant file says of it."""

    __tablename__ = "valves"

    id: Mapped[str] = mapped_column(primary_key=True)
    description: Mapped[str] = mapped_column(default="")
    area: Mapped[str] = mapped_column(default="")
    criticality: Mapped[int] = mapped_column(default=2)


class RunRow(Base):
    """One run of the program over many valves."""

    __tablename__ = "runs"

    id: Mapped[int] = mapped_column(primary_key=True)
    started: Mapped[datetime]
    finished: Mapped[datetime | None]
    command: Mapped[str]  # without secrets
    software_version: Mapped[str]
    settings_digest: Mapped[str]
    counts: Mapped[dict[str, Any]]  # screenings per verdict, known when the run has finished


class ScreeningRow(Base):
    """One valve, one window. The same window screened again replaces its row.

    ``at`` is the instant the screening speaks for: the end of its window, or the moment it was
    saved where the source does not tell its dates. S and J are in percent of OP span.
    """

    __tablename__ = "screenings"
    __table_args__ = (
        UniqueConstraint("valve", "window_key"),
        Index("ix_screenings_valve_at", "valve", "at", "id"),
        Index("ix_screenings_run", "run_id"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    valve: Mapped[str] = _of_valve()
    run_id: Mapped[int] = mapped_column(ForeignKey("runs.id"))
    window_key: Mapped[str]
    window_start: Mapped[datetime | None]
    window_end: Mapped[datetime | None]
    at: Mapped[datetime]
    verdict: Mapped[str]
    reason: Mapped[str]
    advice: Mapped[str]
    shape: Mapped[str | None]
    severity: Mapped[float]
    confidence: Mapped[float | None]
    grade: Mapped[str]
    grade_reasons: Mapped[list[str]]
    s_percent: Mapped[float | None]
    s_low_percent: Mapped[float | None]
    s_high_percent: Mapped[float | None]
    s_reason: Mapped[str | None]
    j_percent: Mapped[float | None]
    j_low_percent: Mapped[float | None]
    j_high_percent: Mapped[float | None]
    j_reason: Mapped[str | None]
    residuals: Mapped[dict[str, Any]]
    still_seen: Mapped[list[str]]
    baseline_note: Mapped[str]
    source: Mapped[str]
    source_digest: Mapped[str]
    layout: Mapped[str]
    decisions: Mapped[list[str]]
    software_version: Mapped[str]
    settings_digest: Mapped[str]
    seconds: Mapped[float]


class IndicatorRow(Base):
    """One number of one screening; valve and ``at`` are repeated here for the trend's index."""

    __tablename__ = "indicators"
    __table_args__ = (Index("ix_indicators_trend", "valve", "name", "at"),)

    screening_id: Mapped[int] = mapped_column(
        ForeignKey("screenings.id", ondelete="CASCADE"), primary_key=True
    )
    name: Mapped[str] = mapped_column(primary_key=True)
    valve: Mapped[str] = _of_valve()
    at: Mapped[datetime]
    value: Mapped[float | None]
    low: Mapped[float | None]
    high: Mapped[float | None]
    unit: Mapped[str]


class NetworkRow(Base):
    """A valve's NARX network. At most one of each kind is active; older baselines stay."""

    __tablename__ = "networks"
    __table_args__ = (
        Index(
            "uq_networks_active",
            "valve",
            "kind",
            unique=True,
            sqlite_where=text("active"),
            postgresql_where=text("active"),
        ),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    valve: Mapped[str] = _of_valve()
    kind: Mapped[str]  # "baseline" or "fitted"
    network: Mapped[bytes]
    created: Mapped[datetime]
    window_start: Mapped[datetime | None]
    window_end: Mapped[datetime | None]
    reason: Mapped[str]
    active: Mapped[bool]


class RemarkRow(Base):
    """The columns that maintenance and notes share."""

    __abstract__ = True

    id: Mapped[int] = mapped_column(primary_key=True)
    valve: Mapped[str] = mapped_column(ForeignKey("valves.id", ondelete="CASCADE"))
    at: Mapped[datetime]
    note: Mapped[str]
    who: Mapped[str]


class MaintenanceRow(RemarkRow):
    """Work on a valve, after which its old baseline no longer describes it."""

    __tablename__ = "maintenance"
    __table_args__ = (Index("ix_maintenance_valve_at", "valve", "at"),)


class NoteRow(RemarkRow):
    """A remark about a valve; it changes nothing but what people know."""

    __tablename__ = "notes"
    __table_args__ = (Index("ix_notes_valve_at", "valve", "at"),)
