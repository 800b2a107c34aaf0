"""Browser sessions: started by a password, identified by a cookie, ended by time or on request.

The store holds the digest of the cookie, so that sessions survive a restart and cannot be taken
over by reading the database. Each request checks the store, so that ending takes effect at once.
"""

from __future__ import annotations

import hmac
from datetime import datetime, timedelta

from stemwatch.service.access.permissions import CurrentUser
from stemwatch.service.access.random_secrets import digest_of, new_secret
from stemwatch.service.store.accounts.records import WebSession
from stemwatch.service.store.store import Store

IDLE = timedelta(hours=12)  # a shift; a session that is unused for longer ends
LONGEST = timedelta(days=7)
NOTED_EVERY = timedelta(minutes=1)  # resolution of "last used", to avoid a write per request
SESSION = "session"
_FORMS = b"stemwatch forms"


def begin_session(
    store: Store, user: int, *, now: datetime, address: str = "", agent: str = ""
) -> str:
    """Start a session; return the value of its cookie, which is not stored."""
    secret = new_secret()
    store.web_sessions.begin(
        digest_of(secret),
        user,
        now=now,
        expires=now + LONGEST,
        address=address,
        agent=agent[:200],
    )
    return secret


def user_of_cookie(
    store: Store, cookie: str, now: datetime, *, active: bool = True
) -> CurrentUser | None:
    """The user of this cookie; ``None`` where its session has ended. ``active`` is false for
    requests that a page makes by itself, which do not prolong the session."""
    digest = digest_of(cookie)
    session = store.web_sessions.find(digest, now=now, idle=IDLE)
    if session is None:
        return None
    if active and now - session.seen >= NOTED_EVERY:
        store.web_sessions.touch(digest, now)
    user = session.user
    return CurrentUser(
        name=user.name,
        role=user.role,
        signed_in_by=SESSION,
        user=user.id,
        session=digest,
        form_token=form_token_of(cookie),
    )


def end_session(store: Store, cookie: str) -> None:
    """End the session of this cookie, if it has one."""
    store.web_sessions.end(digest_of(cookie))


def form_token_of(cookie: str) -> str:
    """The token in the forms of a page. It is derived from the cookie, so that it belongs to one
    session and is the same after a restart; the cookie cannot be derived from it."""
    return hmac.new(cookie.encode("utf-8", "replace"), _FORMS, "sha256").hexdigest()


def sessions_of(store: Store, user: int, now: datetime) -> list[WebSession]:
    """The sessions of a user that have not ended."""
    return store.web_sessions.of_user(user, now=now, idle=IDLE)
