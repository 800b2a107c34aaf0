"""``AccessLinks``: one-time links with which people choose their own passwords."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import ColumnElement, select, update
from sqlalchemy.orm import Session

from stemwatch.service.store.accounts.records import OneTimeLink, OneTimeLinkKind, UserRole
from stemwatch.service.store.accounts.tables import LinkRow
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.storable import from_row


class AccessLinks:
    """One-time links; only their digests are stored. Methods raise ``StoreError``.

    ``Accounts`` marks a link as used in the same transaction that adds or changes the user.
    """

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def make(
        self,
        digest: str,
        kind: OneTimeLinkKind,
        role: UserRole,
        *,
        made_by: str,
        now: datetime,
        expires: datetime,
        user: int | None = None,
        note: str = "",
    ) -> OneTimeLink:
        """Store a one-time link. A link for the first admin, or for a password of ``user``,
        withdraws earlier ones of that kind."""
        with self._transactions.writing("making a one-time link") as session:
            if kind is OneTimeLinkKind.FIRST:
                revoke(session, now, LinkRow.kind == kind.value)
            elif user is not None:
                revoke(session, now, LinkRow.user_id == user)
            row = LinkRow(
                digest=digest,
                kind=kind.value,
                role=role.value,
                user_id=user,
                note=note,
                created=now,
                created_by=made_by,
                expires=expires,
                used=None,
                revoked=None,
            )
            session.add(row)
            session.flush()
            return _link_of(row)

    def find(self, digest: str) -> OneTimeLink | None:
        """The one-time link with this digest, also where it is no longer valid."""
        with self._transactions.reading() as session:
            row = session.scalar(select(LinkRow).where(LinkRow.digest == digest))
            return None if row is None else _link_of(row)

    def open(self, now: datetime) -> list[OneTimeLink]:
        """Valid one-time links, newest first."""
        statement = select(LinkRow).where(*_open(now)).order_by(LinkRow.id.desc())
        with self._transactions.reading() as session:
            return [_link_of(row) for row in session.scalars(statement)]

    def revoke(self, link: int, now: datetime) -> bool:
        """Withdraw a one-time link; false where there was no valid one."""
        with self._transactions.writing("withdrawing a one-time link") as session:
            return revoke(session, now, LinkRow.id == link)


def use_up(session: Session, digest: str, now: datetime) -> LinkRow | None:
    """Mark the link as used and return it; in one statement, so that only one of two succeeds."""
    number = session.execute(
        update(LinkRow)
        .where(LinkRow.digest == digest, *_open(now))
        .values(used=now)
        .returning(LinkRow.id)
    ).scalar_one_or_none()
    return None if number is None else session.get(LinkRow, number)


def revoke(session: Session, now: datetime, condition: ColumnElement[bool]) -> bool:
    """Withdraw the valid links that meet ``condition``; whether there were any."""
    result = session.execute(
        update(LinkRow).where(condition, *_open(now)).values(revoked=now).returning(LinkRow.id)
    )
    return bool(result.all())


def _open(now: datetime) -> tuple[ColumnElement[bool], ...]:
    return LinkRow.used.is_(None), LinkRow.revoked.is_(None), LinkRow.expires > now


def _link_of(row: LinkRow) -> OneTimeLink:
    return from_row(OneTimeLink, row, kind=OneTimeLinkKind(row.kind), role=UserRole(row.role))
