"""``Deliveries``: messages to people, from queueing until they are sent or given up.

A message is queued in the transaction that marks its alerts as told, so none is lost or queued
twice. If a process dies after sending but before recording it, the message is sent again with the
same key, by which the receiver can recognise it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import or_, select, update

from stemwatch.service.store.alerts.alerts import StoredAlert, by_place, stored_alert
from stemwatch.service.store.alerts.tables import AlertRow, DeliveryRow
from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions, database_now
from stemwatch.service.store.storable import from_row

CLAIM = timedelta(minutes=5)  # longer than any notifier takes to send one message
LONGEST_WAIT = timedelta(hours=1)  # between two attempts


@dataclass(frozen=True, kw_only=True)
class StoredDelivery:
    """One message to one notifier. ``key`` is the same for each attempt."""

    id: int
    notifier: str
    key: str
    message: Mapping[str, Any]
    created: datetime
    attempts: int
    next_try: datetime
    sent: datetime | None
    given_up: bool
    error: str


class Deliveries:
    """The stored messages. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def undelivered(self) -> list[StoredAlert]:
        """Open alerts that are in no message yet and not snoozed, in the order of the ranking."""
        now = datetime.now(UTC)
        statement = select(AlertRow).where(
            AlertRow.told.is_(None),
            AlertRow.closed.is_(None),
            AlertRow.false_alarm.is_(False),
            or_(AlertRow.snoozed_until.is_(None), AlertRow.snoozed_until <= now),
        )
        with self._transactions.reading() as session:
            return by_place(session, [stored_alert(row) for row in session.scalars(statement)])

    def put(
        self, messages: Mapping[str, Mapping[str, Any]], key: str, alerts: Sequence[int]
    ) -> bool:
        """Queue each notifier's message about ``alerts``; false where another process has queued
        them."""
        now = datetime.now(UTC)
        with self._transactions.writing("queueing a message") as session:
            alerts_in_message = session.execute(
                update(AlertRow)
                .where(AlertRow.id.in_(alerts), AlertRow.told.is_(None))
                .values(told=now)
                .returning(AlertRow.id)
            ).all()
            if len(alerts_in_message) != len(alerts):
                session.rollback()  # another process has queued some of them
                return False
            for notifier, message in messages.items():
                values = {
                    "notifier": notifier,
                    "key": key,
                    "message": dict(message),
                    "created": now,
                    "attempts": 0,
                    "next_try": now,
                    "given_up": False,
                    "error": "",
                }
                session.execute(
                    upsert(session, DeliveryRow, [values], ("notifier", "key"), update=False)
                )
        return True

    def claim(self, *, except_notifiers: Collection[str] = ()) -> StoredDelivery | None:
        """Reserve the next due message for a few minutes; ``None`` where none is due but those of
        the notifiers ``except_notifiers``. One whose time lies further ahead than any wait is due:
        the clock was set back since."""
        with self._transactions.writing("taking a message") as session:
            now = database_now(session)
            next_try, claimed = DeliveryRow.next_try, DeliveryRow.claimed_until
            row = session.scalar(
                select(DeliveryRow)
                .where(
                    DeliveryRow.sent.is_(None),
                    DeliveryRow.given_up.is_(False),
                    DeliveryRow.notifier.not_in(except_notifiers),
                    or_(next_try <= now, next_try > now + LONGEST_WAIT + CLAIM),
                    or_(claimed.is_(None), claimed < now, claimed > now + 2 * CLAIM),
                )
                .order_by(DeliveryRow.next_try)
                .limit(1)
                .with_for_update(skip_locked=True)
            )
            if row is None:
                return None
            row.claimed_until, row.attempts = now + CLAIM, row.attempts + 1
            return _stored(row)

    def sent(self, delivery: int) -> None:
        """Record that a message was sent."""
        self._change(delivery, sent=datetime.now(UTC), claimed_until=None, error="")

    def failed(self, delivery: int, error: str, next_try: datetime | None) -> None:
        """Record why a message could not be sent; with ``next_try`` ``None`` it is given up."""
        later = {"next_try": next_try} if next_try is not None else {"given_up": True}
        self._change(delivery, claimed_until=None, error=error, **later)

    def recent(self, limit: int = 100) -> list[StoredDelivery]:
        """The newest messages, newest first."""
        with self._transactions.reading() as session:
            rows = select(DeliveryRow).order_by(DeliveryRow.id.desc()).limit(limit)
            return [_stored(row) for row in session.scalars(rows)]

    def _change(self, delivery: int, **values: Any) -> None:
        with self._transactions.writing("noting a message's state") as session:
            session.execute(update(DeliveryRow).where(DeliveryRow.id == delivery).values(**values))


def _stored(row: DeliveryRow) -> StoredDelivery:
    return from_row(StoredDelivery, row)
