"""Tables of schedules, of the valves of each run, and of leases."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from stemwatch.service.store.database.columns import TableBase


class RunValveRow(TableBase):
    """One valve of a run and its state."""

    __tablename__ = "run_valves"
    __table_args__ = (
        Index("ix_run_valves_state", "run_id", "state"),
        Index("ix_run_valves_valve", "valve"),
    )

    run_id: Mapped[int] = mapped_column(
        ForeignKey("runs.id", ondelete="CASCADE"), primary_key=True, autoincrement=False
    )
    valve: Mapped[str] = mapped_column(
        ForeignKey("valves.id", ondelete="CASCADE"), primary_key=True
    )
    state: Mapped[str]  # a ``ValveState``
    reason: Mapped[str]
    finished: Mapped[datetime | None]


class ScheduleRow(TableBase):
    """A schedule, of the plant file or made on the pages.

    ``cron`` or ``every_s``; empty ``areas``, ``units`` and ``valves`` mean all. ``last_due`` is the
    last instant that was queued or noted as missed.
    """

    __tablename__ = "schedules"

    name: Mapped[str] = mapped_column(primary_key=True)
    origin: Mapped[str]  # "plant.toml" or "browser"
    cron: Mapped[str | None]
    every_s: Mapped[float | None]
    jitter_s: Mapped[float]
    window_s: Mapped[float | None]
    areas: Mapped[list[str]]
    units: Mapped[list[str]] = mapped_column(server_default="[]")
    valves: Mapped[list[str]]
    enabled: Mapped[bool]
    created: Mapped[datetime]
    last_due: Mapped[datetime | None]
    next_due: Mapped[datetime | None]


class LeaseRow(TableBase):
    """A duty that one process has until ``until``, unless it renews the lease."""

    __tablename__ = "leases"

    name: Mapped[str] = mapped_column(primary_key=True)
    owner: Mapped[str]
    until: Mapped[datetime]


class SettingRow(TableBase):
    """A named value that somebody has set on the pages; see ``browser_settings``."""

    __tablename__ = "settings"

    name: Mapped[str] = mapped_column(primary_key=True)
    value: Mapped[dict[str, Any]]
    changed: Mapped[datetime]
    who: Mapped[str]
