"""API tokens: shown once, stored as digests, limited to their scopes and to the present rights of
their user."""

from __future__ import annotations

import hmac
from collections.abc import Sequence
from datetime import datetime, timedelta

from stemwatch.service.access.links import BadName, check_name
from stemwatch.service.access.permissions import CurrentUser, scopes_of
from stemwatch.service.access.random_secrets import digest_of, new_secret
from stemwatch.service.store.accounts.records import Scope, User, UserRole
from stemwatch.service.store.store import Store

BEGINS = "stw_"  # prefix by which people and secret scanners recognise a token
SHOWN = len(BEGINS) + 6
NOTED_EVERY = timedelta(minutes=1)
ENVIRONMENT = "STEMWATCH_WEB_TOKEN"
SHORTEST_OF_ENVIRONMENT = 16
MOST_OF_USER = 50


class BadToken(ValueError):
    """The token cannot be created; the text says what is expected."""


def make_token(
    store: Store,
    user: User,
    name: str,
    scopes: Sequence[Scope],
    *,
    now: datetime,
    days: int | None = 90,
) -> str:
    """Create a token of ``user`` and return it; only its digest is stored. It expires after
    ``days``, never with ``None``. Raises ``BadToken``."""
    try:
        name = check_name(name)
    except BadName as error:
        raise BadToken(str(error)) from None
    allowed = scopes_of(user.role)
    if not scopes or any(scope not in allowed for scope in scopes):
        words = ", ".join(allowed)
        raise BadToken(f"a token of a user who is {user.role} has scopes out of {words}")
    if (
        len([token for token in store.api_tokens.all(user.id) if token.is_open(now)])
        >= MOST_OF_USER
    ):
        raise BadToken(f"at most {MOST_OF_USER} tokens of one user; revoke one first")
    secret = BEGINS + new_secret()
    store.api_tokens.add(
        digest_of(secret),
        user.id,
        name,
        [scope for scope in Scope if scope in scopes],
        begins=secret[:SHOWN],
        now=now,
        expires=None if days is None else now + timedelta(days=days),
    )
    return secret


def user_of_token(store: Store, secret: str, now: datetime) -> CurrentUser | None:
    """The user of this token, with its scopes; ``None`` where it is not valid."""
    token = store.api_tokens.find(digest_of(secret)) if secret else None
    if token is None or not token.is_open(now):
        return None
    if token.last_used is None or now - token.last_used >= NOTED_EVERY:
        store.api_tokens.note_use(token.id, now)
    return CurrentUser(
        name=token.user.name,
        role=token.user.role,
        signed_in_by=f"token {token.name}",
        user=token.user.id,
        scopes=frozenset(token.scopes),
    )


def user_of_environment(secret: str, expected: str) -> CurrentUser | None:
    """The user for the token in the service's environment, with the scopes to read and to act;
    ``None`` where ``secret`` differs or the expected token is too short to be safe."""
    if len(expected) < SHORTEST_OF_ENVIRONMENT:
        return None
    if not hmac.compare_digest(secret.encode("utf-8", "replace"), expected.encode()):
        return None
    return CurrentUser(
        name=ENVIRONMENT,
        role=UserRole.ENGINEER,
        signed_in_by="token of the environment",
        scopes=frozenset((Scope.READ, Scope.ACT)),
    )
