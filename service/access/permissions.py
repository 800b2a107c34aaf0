"""The table of rights: each operation and the lowest role that may do it.

A role includes the rights of lower roles. A token allows what its scopes allow, and never more than
its user may do at that moment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from stemwatch.service.store.accounts.records import Scope, UserRole


class Operation(StrEnum):
    """An operation that needs a right; the values appear in the audit log."""

    OPEN = "open"  # sign in, use a one-time link, load styles, health checks
    READ = "read"
    METRICS = "read metrics"
    OWN = "own account"  # the user's own password, sessions and tokens
    LOG_OUT = "log out"
    ALERT = "settle an alert"
    NOTE = "add a note"
    MAINTENANCE = "record maintenance"
    FEEDBACK = "say what was found"
    BASELINE = "set a baseline"
    RUN = "begin a run"
    CANCEL = "cancel a run"
    SETTINGS = "change settings"
    USERS = "manage users"
    TOKENS = "manage tokens"
    AUDIT = "read the audit log"
    UNDECLARED = "use a route without a declared right"  # a bug; admins only


@dataclass(frozen=True)
class Permission:
    """The lowest role, ``None`` for anybody. An ``in_person`` operation needs a browser session, so
    that a stolen token cannot be used to create further access."""

    least: UserRole | None
    in_person: bool = False


PERMISSIONS: Mapping[Operation, Permission] = MappingProxyType(
    {
        Operation.OPEN: Permission(None),
        Operation.READ: Permission(UserRole.VIEWER),
        Operation.METRICS: Permission(UserRole.VIEWER),
        Operation.OWN: Permission(UserRole.VIEWER, in_person=True),
        Operation.LOG_OUT: Permission(UserRole.VIEWER, in_person=True),
        Operation.ALERT: Permission(UserRole.ENGINEER),
        Operation.NOTE: Permission(UserRole.ENGINEER),
        Operation.MAINTENANCE: Permission(UserRole.ENGINEER),
        Operation.FEEDBACK: Permission(UserRole.ENGINEER),
        Operation.BASELINE: Permission(UserRole.ENGINEER),
        Operation.RUN: Permission(UserRole.ENGINEER),
        Operation.CANCEL: Permission(UserRole.ENGINEER),
        Operation.SETTINGS: Permission(UserRole.ADMIN, in_person=True),
        Operation.USERS: Permission(UserRole.ADMIN, in_person=True),
        Operation.TOKENS: Permission(UserRole.ADMIN, in_person=True),
        Operation.AUDIT: Permission(UserRole.ADMIN),
        Operation.UNDECLARED: Permission(UserRole.ADMIN, in_person=True),
    }
)
SCOPE_OF: Mapping[UserRole, Scope] = MappingProxyType(
    {UserRole.VIEWER: Scope.READ, UserRole.ENGINEER: Scope.ACT, UserRole.ADMIN: Scope.ADMIN}
)


@dataclass(frozen=True, kw_only=True)
class CurrentUser:
    """The user of a request. ``scopes`` is ``None`` for a browser session; ``user`` is the user's
    number, 0 for the token of the environment. ``session`` is the digest of the session,
    ``form_token`` the token in its forms."""

    name: str
    role: UserRole
    signed_in_by: str
    user: int = 0
    scopes: frozenset[Scope] | None = None
    session: str = ""
    form_token: str = ""

    def may(self, operation: Operation) -> bool:
        """Whether the user's role and scopes allow ``operation``."""
        right = PERMISSIONS[operation]
        if right.least is None:
            return True
        if self.role.rank < right.least.rank:
            return False
        if self.scopes is None:
            return True
        return not right.in_person and SCOPE_OF[right.least] in self.scopes

    def signature(self, text: str = "") -> str:
        """The name for signatures: the user's own, preceded by the name of the person for whom a
        program says that it acts."""
        text = " ".join(text.split())
        return f"{text} (through {self.name})" if text and text != self.name else self.name


def scopes_of(role: UserRole) -> tuple[Scope, ...]:
    """The scopes that a token of somebody with this role may have."""
    return tuple(scope for needed, scope in SCOPE_OF.items() if needed.rank <= role.rank)
