"""Tables of alerts and of the messages about them."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, Index, UniqueConstraint, text
from sqlalchemy.orm import Mapped, mapped_column

from stemwatch.service.store.database.columns import TableBase


class AlertRow(TableBase):
    """An alert. At most one of each ``cause`` is open.

    ``evidence`` holds the numbers at the time of raising. False alarms are kept: they are the only
    feedback from the plant on whether alerts are right.
    """

    __tablename__ = "alerts"
    __table_args__ = (
        Index(
            "uq_alerts_open",
            "cause",
            unique=True,
            sqlite_where=text("closed IS NULL"),
            postgresql_where=text("closed IS NULL"),
        ),
        Index("ix_alerts_closed_opened", "closed", "opened"),
        Index("ix_alerts_valve", "valve", "opened"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    cause: Mapped[str]  # what makes two alerts the same: "sticky:FIC-101"
    kind: Mapped[str]  # an ``AlertKind``
    valve: Mapped[str | None] = mapped_column(ForeignKey("valves.id", ondelete="CASCADE"))
    source: Mapped[str | None]
    severity: Mapped[str]  # an ``AlertSeverity``
    text: Mapped[str]
    evidence: Mapped[dict[str, Any]]
    run_id: Mapped[int | None]  # the run that raised it
    opened: Mapped[datetime]
    seen: Mapped[datetime]  # when its cause was last found again
    closed: Mapped[datetime | None]
    closed_why: Mapped[str]
    acknowledged: Mapped[datetime | None]
    acknowledged_by: Mapped[str]
    comment: Mapped[str]
    snoozed_until: Mapped[datetime | None]
    snoozed_by: Mapped[str]
    false_alarm: Mapped[bool]
    told: Mapped[datetime | None]  # when it was put into messages


class DeliveryRow(TableBase):
    """One message to one notifier, retried until it is sent or given up."""

    __tablename__ = "deliveries"
    __table_args__ = (
        UniqueConstraint("notifier", "key"),
        Index("ix_deliveries_due", "sent", "next_try"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    notifier: Mapped[str]
    key: Mapped[str]  # identifies the message; the same for every attempt
    message: Mapped[dict[str, Any]]
    created: Mapped[datetime]
    attempts: Mapped[int]
    next_try: Mapped[datetime]
    claimed_until: Mapped[datetime | None]  # a process is sending it
    sent: Mapped[datetime | None]
    given_up: Mapped[bool]
    error: Mapped[str]  # the last one, without secrets
