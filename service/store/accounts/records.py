"""Users, links, sessions, tokens and audit entries as the store returns them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum


class UserRole(StrEnum):
    """A user's role; each includes the rights of the one before."""

    VIEWER = "viewer"
    ENGINEER = "engineer"
    ADMIN = "admin"

    @property
    def rank(self) -> int:
        """0 for a viewer, 2 for an admin."""
        return list(UserRole).index(self)


class Scope(StrEnum):
    """What a token allows: the rights of a viewer, those that an engineer has in addition, or
    those that an admin has in addition."""

    READ = "read"
    ACT = "act"
    ADMIN = "admin"


class OneTimeLinkKind(StrEnum):
    """The purpose of a one-time link."""

    FIRST = "first"  # the first admin
    INVITATION = "invitation"  # a new user
    PASSWORD = "password"  # a new password of a user


class AuditOutcome(StrEnum):
    """The outcome of an audited action."""

    DONE = "done"
    REFUSED = "refused"  # the user lacks the right
    FAILED = "failed"  # the action raised an error


@dataclass(frozen=True, kw_only=True)
class User:
    """A user, without the password hash."""

    id: int
    name: str
    role: UserRole
    created: datetime
    created_by: str
    password_changed: datetime
    last_login: datetime | None
    disabled: datetime | None


@dataclass(frozen=True, kw_only=True)
class OneTimeLink:
    """A one-time link, without its secret, of which only the digest is stored."""

    id: int
    kind: OneTimeLinkKind
    role: UserRole
    user_id: int | None
    note: str
    created: datetime
    created_by: str
    expires: datetime
    used: datetime | None
    revoked: datetime | None

    def is_open(self, now: datetime) -> bool:
        """Whether it is valid at ``now``."""
        return self.used is None and self.revoked is None and now < self.expires


@dataclass(frozen=True, kw_only=True)
class WebSession:
    """A browser session of a user; ``digest`` is that of its cookie."""

    digest: str
    user: User
    created: datetime
    seen: datetime
    expires: datetime
    address: str
    agent: str


@dataclass(frozen=True, kw_only=True)
class ApiToken:
    """An API token without its secret; ``begins`` are its first characters, shown to people."""

    id: int
    user: User
    name: str
    begins: str
    scopes: tuple[Scope, ...]
    created: datetime
    expires: datetime | None
    last_used: datetime | None
    revoked: datetime | None

    def is_open(self, now: datetime) -> bool:
        """Whether it is valid at ``now``."""
        expired = self.expires is not None and now >= self.expires
        return self.revoked is None and not expired and self.user.disabled is None


@dataclass(frozen=True, kw_only=True)
class AuditEntry:
    """One action in the audit log: when, who, signed in how, from which address, what, on what."""

    at: datetime
    who: str
    how: str
    address: str
    action: str
    about: str = ""
    outcome: AuditOutcome = AuditOutcome.DONE
    detail: str = ""


@dataclass(frozen=True, kw_only=True)
class StoredAuditEntry(AuditEntry):
    """An entry with its number, which is used for paging."""

    id: int
