"""``Accounts``: the users, their roles and password hashes."""

from __future__ import annotations

import unicodedata
from datetime import datetime

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from stemwatch.service.store.accounts.one_time_links import revoke, use_up
from stemwatch.service.store.accounts.records import OneTimeLinkKind, User, UserRole
from stemwatch.service.store.accounts.tables import LinkRow, SessionRow, UserRow
from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.storable import clean_text, from_row


class NameTaken(StoreError):
    """A user with this name exists already; upper and lower case do not differ."""


class LastAdmin(StoreError):
    """The change would leave no enabled admin."""


def name_key(name: str) -> str:
    """The name as it is compared: Unicode NFKC, case folded, blanks collapsed."""
    return " ".join(unicodedata.normalize("NFKC", clean_text(name)).casefold().split())


class Accounts:
    """The stored users. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def is_empty(self) -> bool:
        """Whether there is no user yet."""
        with self._transactions.reading() as session:
            return session.scalar(select(UserRow.id).limit(1)) is None

    def all(self) -> list[User]:
        """Every user, by name."""
        with self._transactions.reading() as session:
            return [user_of(row) for row in session.scalars(select(UserRow).order_by(UserRow.name))]

    def find(self, name: str) -> User | None:
        """The user with this name, ``None`` where there is none."""
        with self._transactions.reading() as session:
            row = _by_name(session, name)
            return None if row is None else user_of(row)

    def get(self, user: int) -> User | None:
        """The user with this number, ``None`` where there is none."""
        with self._transactions.reading() as session:
            row = session.get(UserRow, user)
            return None if row is None else user_of(row)

    def password_of(self, name: str) -> tuple[User, str] | None:
        """A user and the password hash, ``None`` where there is no such user."""
        with self._transactions.reading() as session:
            row = _by_name(session, name)
            return None if row is None else (user_of(row), row.password)

    def add(
        self, name: str, role: UserRole, password: str, *, added_by: str, now: datetime
    ) -> User:
        """Add a user; ``password`` is a hash. Raises ``NameTaken``."""
        with self._transactions.writing("adding a user") as session:
            return _add(session, name, role, password, added_by, now)

    def add_by_link(self, digest: str, name: str, password: str, now: datetime) -> User | None:
        """Add a user and mark the one-time link as used, in one transaction; ``None`` where the
        link is not valid. Raises ``NameTaken``; the link then remains valid."""
        with self._transactions.writing("using a one-time link") as session:
            link = use_up(session, digest, now)
            if link is None or link.kind == OneTimeLinkKind.PASSWORD.value:
                return None
            first = link.kind == OneTimeLinkKind.FIRST.value
            if first and session.scalar(select(UserRow.id).limit(1)) is not None:
                return None
            created_by = link.created_by or "first start"
            return _add(session, name, UserRole(link.role), password, created_by, now)

    def new_password_by_link(self, digest: str, password: str, now: datetime) -> User | None:
        """Set a password (a hash) by a one-time link; ends all sessions of the user."""
        with self._transactions.writing("using a one-time link") as session:
            link = use_up(session, digest, now)
            if link is None or link.kind != OneTimeLinkKind.PASSWORD.value or link.user_id is None:
                return None
            return _set_password(session, link.user_id, password, now)

    def set_password(self, user: int, password: str, now: datetime) -> User:
        """Set a password (a hash); ends all sessions of the user."""
        with self._transactions.writing("changing a password") as session:
            return _set_password(session, user, password, now)

    def note_login(self, user: int, now: datetime, rehashed: str | None = None) -> None:
        """Record a sign-in; ``rehashed`` is the same password hashed with newer parameters."""
        with self._transactions.writing("noting a login") as session:
            row = _locked_user(session, user)
            row.last_login = now
            if rehashed is not None:
                row.password = rehashed

    def set_role(self, user: int, role: UserRole) -> User:
        """Change a user's role. Raises ``LastAdmin``."""
        with self._transactions.writing("changing a role") as session:
            if role is not UserRole.ADMIN:
                _refuse_last_admin(session, user)
            row = _locked_user(session, user)
            row.role = role.value
            return user_of(row)

    def disable(self, user: int, now: datetime) -> User:
        """Disable a user: sessions end, links are withdrawn, tokens are invalid until the user is
        enabled again. Raises ``LastAdmin``."""
        with self._transactions.writing("disabling a user") as session:
            _refuse_last_admin(session, user)
            row = _locked_user(session, user)
            row.disabled = row.disabled or now
            session.execute(delete(SessionRow).where(SessionRow.user_id == user))
            revoke(session, now, LinkRow.user_id == user)
            return user_of(row)

    def enable(self, user: int) -> User:
        """Allow a disabled user to sign in again."""
        with self._transactions.writing("enabling a user") as session:
            row = _locked_user(session, user)
            row.disabled = None
            return user_of(row)


def user_of(row: UserRow) -> User:
    """The row as a ``User``."""
    return from_row(User, row, role=UserRole(row.role))


def _by_name(session: Session, name: str) -> UserRow | None:
    return session.scalar(select(UserRow).where(UserRow.name_key == name_key(name)))


def _locked_user(session: Session, user: int) -> UserRow:
    row = session.scalar(select(UserRow).where(UserRow.id == user).with_for_update())
    if row is None:
        raise StoreError(f"there is no user {user}")
    return row


def _add(
    session: Session, name: str, role: UserRole, password: str, added_by: str, now: datetime
) -> User:
    values = {
        "name": " ".join(name.split()),
        "name_key": name_key(name),
        "role": role.value,
        "password": password,
        "created": now,
        "created_by": added_by,
        "password_changed": now,
    }
    statement = upsert(
        session, UserRow, [values], ("name_key",), update=False, returning=UserRow.id
    )
    number = session.execute(statement).scalar_one_or_none()
    if number is None:
        raise NameTaken(f"there is a user {values['name']} already; choose another name")
    return user_of(_locked_user(session, number))


def _set_password(session: Session, user: int, password: str, now: datetime) -> User:
    row = _locked_user(session, user)
    row.password, row.password_changed = password, now
    session.execute(delete(SessionRow).where(SessionRow.user_id == user))
    revoke(session, now, LinkRow.user_id == user)
    return user_of(row)


def _refuse_last_admin(session: Session, user: int) -> None:
    """Raise ``LastAdmin`` where nobody else is an enabled admin. All of them are locked: otherwise
    two changes at the same time could each leave the other's user as the last one."""
    admins = session.scalars(
        select(UserRow)
        .where(UserRow.role == UserRole.ADMIN.value, UserRow.disabled.is_(None))
        .order_by(UserRow.id)
        .with_for_update()
    ).all()
    if [admin.id for admin in admins] == [user]:
        raise LastAdmin(f"{admins[0].name} is the only admin; make somebody else one first")
