"""The nouns of who may do what, as the store gives them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum


class UserRole(StrEnum):
    """What somebody is here. Each may do what the one before may, and more."""

    VIEWER = "viewer"
    ENGINEER = "engineer"
    ADMIN = "admin"

    @property
    def rank(self) -> int:
        """0 for a viewer; the higher, the more may be done."""
        return list(UserRole).index(self)


class Scope(StrEnum):
    """What a token is good for: what a viewer, an engineer or an admin may do beyond the last."""

    READ = "read"
    ACT = "act"
    ADMIN = "admin"


class OneTimeLinkKind(StrEnum):
    """What a one-time link is for."""

    FIRST = "first"  # the first admin
    INVITATION = "invitation"  # a new user
    PASSWORD = "password"  # a new password of a user


class AuditOutcome(StrEnum):
    """What became of what somebody wanted."""

    DONE = "done"
    REFUSED = "refused"  # the right was missing
    FAILED = "failed"  # it could not be done


@dataclass(frozen=True, kw_only=True)
class User:
    """Somebody who may sign in, without the password's hash."""

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
    """A one-time link, without the link itself, which nobody can read again."""

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
        """Whether it still lets somebody in."""
        return self.used is None and self.revoked is None and now < self.expires


@dataclass(frozen=True, kw_only=True)
class WebSession:
    """A browser in which somebody signed in; ``digest`` is that of its cookie."""

    digest: str
    user: User
    created: datetime
    seen: datetime
    expires: datetime
    address: str
    agent: str


@dataclass(frozen=True, kw_only=True)
class ApiToken:
    """A token without itself; ``begins`` are the characters by which people know it again."""

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
        """Whether it still lets a program in."""
        late = self.expires is not None and now >= self.expires
        return self.revoked is None and not late and self.user.disabled is None


@dataclass(frozen=True, kw_only=True)
class AuditEntry:
    """What the audit log keeps of one thing that somebody wanted."""

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
    """An entry with its number, by which the log is read page by page."""

    id: int
