"""``LoginAttempts``: failed attempts to sign in, counted across restarts and processes.

An attempt counts as failed from its start until it succeeds, so that parallel attempts are all
counted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timedelta

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from stemwatch.service.store.accounts.tables import AttemptRow
from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions

# Gives the wait before the next attempt for a number of failures.
Wait = Callable[[int], timedelta]


class LoginAttempts:
    """Counts by key, such as a name or an address. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def begin(
        self, waits: Mapping[str, Wait], *, now: datetime, forget: timedelta
    ) -> datetime | None:
        """Count an attempt under each key and return ``None``. Where a key has to wait, count
        nothing and return the end of the wait. Counts older than ``forget`` restart at one."""
        with self._transactions.writing("counting an attempt to sign in") as session:
            rows = {key: _row(session, key, now) for key in sorted(waits)}
            waiting = [row.until for row in rows.values() if row.until > now]
            if waiting:
                return max(waiting)
            for key, row in rows.items():
                row.count = 1 if row.last < now - forget else row.count + 1
                row.last, row.until = now, now + waits[key](row.count)
        return None

    def refused(self, key: str, *, now: datetime, interval: timedelta) -> int:
        """Count an attempt that had to wait. Returns the number of such attempts since the last
        report, at most once in ``interval``, and 0 in between; attempts before a pause are
        included."""
        with self._transactions.writing("counting refused attempts to sign in") as session:
            row = _row(session, key, now)
            row.count, row.last = row.count + 1, now
            if row.until > now:
                return 0
            count, row.count, row.until = row.count, 0, now + interval
            return count

    def succeeded(self, forgotten: str, undone: Sequence[str]) -> None:
        """Record that an attempt succeeded: delete the count under ``forgotten``, and reduce those
        under ``undone`` by this attempt."""
        keys = (forgotten, *undone)
        with self._transactions.writing("noting a login") as session:
            # Locked in the order in which ``begin`` does: two logins at once cannot wait for each
            # other.
            for row in session.scalars(
                select(AttemptRow)
                .where(AttemptRow.key.in_(keys))
                .order_by(AttemptRow.key)
                .with_for_update()
            ):
                row.count, row.until = max(0, row.count - 1), row.last
            session.execute(delete(AttemptRow).where(AttemptRow.key == forgotten))

    def remove_old(self, before: datetime) -> None:
        """Delete counts whose last attempt was before ``before``."""
        with self._transactions.writing("forgetting attempts to sign in") as session:
            session.execute(delete(AttemptRow).where(AttemptRow.last < before))


def _row(session: Session, key: str, now: datetime) -> AttemptRow:
    values = {"key": key, "count": 0, "last": now, "until": now}
    session.execute(upsert(session, AttemptRow, [values], ("key",), update=False))
    return session.scalars(select(AttemptRow).where(AttemptRow.key == key).with_for_update()).one()
