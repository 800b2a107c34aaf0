"""``WebSessions``: browser sessions of signed-in users; they survive a restart."""

from __future__ import annotations

from datetime import datetime, timedelta

from sqlalchemy import Select, delete, or_, select, update

from stemwatch.service.store.accounts.records import WebSession
from stemwatch.service.store.accounts.tables import SessionRow, UserRow
from stemwatch.service.store.accounts.users import user_of
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.storable import from_row


class WebSessions:
    """Sessions, found by the digest of their cookie. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def begin(
        self,
        digest: str,
        user: int,
        *,
        now: datetime,
        expires: datetime,
        address: str = "",
        agent: str = "",
    ) -> None:
        """Store a new session of ``user``."""
        with self._transactions.writing("beginning a session") as session:
            session.add(
                SessionRow(
                    digest=digest,
                    user_id=user,
                    created=now,
                    seen=now,
                    expires=expires,
                    address=address,
                    agent=agent,
                )
            )

    def find(self, digest: str, *, now: datetime, idle: timedelta) -> WebSession | None:
        """The session with this digest; ``None`` where it has expired, was unused for ``idle``, or
        its user is disabled."""
        statement = _with_user().where(
            SessionRow.digest == digest,
            SessionRow.expires > now,
            SessionRow.seen > now - idle,
            UserRow.disabled.is_(None),
        )
        with self._transactions.reading() as session:
            row = session.execute(statement).one_or_none()
            return None if row is None else _session_of(*row)

    def touch(self, digest: str, now: datetime) -> None:
        """Record that a session was used at ``now``."""
        with self._transactions.writing("noting a session") as session:
            session.execute(update(SessionRow).where(SessionRow.digest == digest).values(seen=now))

    def of_user(self, user: int, *, now: datetime, idle: timedelta) -> list[WebSession]:
        """The valid sessions of a user, the last used first."""
        statement = _with_user().where(
            SessionRow.user_id == user,
            SessionRow.expires > now,
            SessionRow.seen > now - idle,
        )
        with self._transactions.reading() as session:
            rows = session.execute(statement.order_by(SessionRow.seen.desc()))
            return [_session_of(*pair) for pair in rows]

    def end(self, digest: str) -> None:
        """End one session."""
        with self._transactions.writing("ending a session") as session:
            session.execute(delete(SessionRow).where(SessionRow.digest == digest))

    def end_others(self, user: int, except_session: str = "") -> None:
        """End all sessions of a user except ``except_session``."""
        with self._transactions.writing("ending sessions") as session:
            session.execute(
                delete(SessionRow).where(
                    SessionRow.user_id == user, SessionRow.digest != except_session
                )
            )

    def remove_ended(self, *, now: datetime, idle: timedelta) -> None:
        """Delete sessions that have expired or were unused for ``idle``."""
        with self._transactions.writing("removing ended sessions") as session:
            ended = or_(SessionRow.expires <= now, SessionRow.seen <= now - idle)
            session.execute(delete(SessionRow).where(ended))


def _with_user() -> Select[SessionRow, UserRow]:
    return select(SessionRow, UserRow).join(UserRow, UserRow.id == SessionRow.user_id)


def _session_of(row: SessionRow, user: UserRow) -> WebSession:
    return from_row(WebSession, row, user=user_of(user))
