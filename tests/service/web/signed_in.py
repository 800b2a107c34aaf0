"""Browsers and programs that are signed in, without a password being worked out for each test."""

from __future__ import annotations

from stemwatch.service.access.permissions import scopes_of
from stemwatch.service.access.sessions import begin_session
from stemwatch.service.access.tokens import make_token
from stemwatch.service.store.accounts.records import Scope, User, UserRole
from stemwatch.service.web.auth.session_cookie import NAME
from stemwatch.service.web.site import Site

PASSWORD = "a long phrase of the tests"
NAMES = {UserRole.VIEWER: "V. Iewer", UserRole.ENGINEER: "E. Ngineer", UserRole.ADMIN: "A. Dmin"}


def user_of(site: Site, role: UserRole = UserRole.ADMIN) -> User:
    """The user of the tests with this role; nobody knows a password of theirs."""
    result = site.store.accounts.find(NAMES[role])
    if result is not None:
        return result
    return site.store.accounts.add(NAMES[role], role, "no hash", added_by="test", now=site.clock())


def cookie_of(site: Site, role: UserRole = UserRole.ADMIN) -> dict[str, str]:
    """The cookie of a browser in which the user with this role has just signed in."""
    return {NAME: begin_session(site.store, user_of(site, role).id, now=site.clock())}


def bearer_of(
    site: Site, role: UserRole = UserRole.ADMIN, scopes: tuple[Scope, ...] = ()
) -> dict[str, str]:
    """The header of a program with a token of this user, of every scope unless told otherwise."""
    user = user_of(site, role)
    given = scopes or scopes_of(role)
    secret = make_token(site.store, user, "test", given, now=site.clock(), days=None)
    return {"authorization": f"Bearer {secret}"}
