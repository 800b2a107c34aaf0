"""Tables of users, one-time links, sessions, tokens, login attempts and the audit log.

No secret is stored: passwords as argon2 hashes, links, cookies and tokens as SHA-256 digests.
"""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from stemwatch.service.store.database.columns import TableBase


def _of_user() -> Mapped[int]:
    """The column of a row's user; the row is deleted with the user."""
    return mapped_column(ForeignKey("users.id", ondelete="CASCADE"))


class UserRow(TableBase):
    """A user. ``name_key`` is the name as it is compared, ``name`` as it is shown."""

    __tablename__ = "users"
    __table_args__ = (Index("uq_users_name_key", "name_key", unique=True),)

    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str]
    name_key: Mapped[str]
    role: Mapped[str]  # a ``UserRole``
    password: Mapped[str]  # its argon2 hash with salt and parameters
    created: Mapped[datetime]
    created_by: Mapped[str]
    password_changed: Mapped[datetime]
    last_login: Mapped[datetime | None]
    disabled: Mapped[datetime | None]


class LinkRow(TableBase):
    """A one-time link: for a new user with ``role``, or for a new password of ``user_id``."""

    __tablename__ = "access_links"
    __table_args__ = (Index("uq_access_links_digest", "digest", unique=True),)

    id: Mapped[int] = mapped_column(primary_key=True)
    digest: Mapped[str]
    kind: Mapped[str]  # a ``OneTimeLinkKind``
    role: Mapped[str]  # a ``UserRole``
    user_id: Mapped[int | None] = mapped_column(ForeignKey("users.id", ondelete="CASCADE"))
    note: Mapped[str]  # for whom it was made
    created: Mapped[datetime]
    created_by: Mapped[str]
    expires: Mapped[datetime]
    used: Mapped[datetime | None]
    revoked: Mapped[datetime | None]


class SessionRow(TableBase):
    """A browser session; ``digest`` is that of its cookie."""

    __tablename__ = "web_sessions"
    __table_args__ = (Index("ix_web_sessions_user_id", "user_id"),)

    digest: Mapped[str] = mapped_column(primary_key=True)
    user_id: Mapped[int] = _of_user()
    created: Mapped[datetime]
    seen: Mapped[datetime]
    expires: Mapped[datetime]
    address: Mapped[str]
    agent: Mapped[str]


class TokenRow(TableBase):
    """An API token of a user."""

    __tablename__ = "api_tokens"
    __table_args__ = (
        Index("uq_api_tokens_digest", "digest", unique=True),
        Index("ix_api_tokens_user_id", "user_id"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    user_id: Mapped[int] = _of_user()
    name: Mapped[str]
    digest: Mapped[str]
    begins: Mapped[str]  # its first characters, shown to people
    scopes: Mapped[list[str]]
    created: Mapped[datetime]
    expires: Mapped[datetime | None]
    last_used: Mapped[datetime | None]
    revoked: Mapped[datetime | None]


class AttemptRow(TableBase):
    """Failed attempts to sign in with one name or from one address."""

    __tablename__ = "login_attempts"

    key: Mapped[str] = mapped_column(primary_key=True)
    count: Mapped[int]
    last: Mapped[datetime]
    until: Mapped[datetime]  # no further attempt before


class AuditRow(TableBase):
    """One entry of the audit log; nothing in the program changes or removes it."""

    __tablename__ = "audit"
    __table_args__ = (
        Index("ix_audit_at", "at"),
        Index("ix_audit_who_at", "who", "at"),
        Index("ix_audit_action_at", "action", "at"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    at: Mapped[datetime]
    who: Mapped[str]
    how: Mapped[str]  # "session", "token …", "command line", empty where nobody was signed in
    address: Mapped[str]
    action: Mapped[str]
    about: Mapped[str]
    outcome: Mapped[str]  # an ``AuditOutcome``
    detail: Mapped[str]
