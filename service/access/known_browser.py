"""Browsers in which a user has signed in before, recognised by a cookie.

Guessing a user's password blocks sign-in with that name for a while; without this cookie it would
block the user as well. Attempts in a browser known for the user are counted separately. Nothing is
stored: the cookie holds a code made with the stored password hash, so that a new password makes
old cookies invalid and they cannot be forged without the hash. The cookie does not sign anyone in.
"""

from __future__ import annotations

import hmac
from datetime import datetime, timedelta

from stemwatch.service.access.random_secrets import digest_of, new_secret

KNOWN_FOR = timedelta(days=90)
MOST_USERS = 8  # users of one browser, such as that of a control room
_BETWEEN = "."
_USE = b"stemwatch known browser"


def remember_browser(cookie: str, password_hash: str, now: datetime) -> str:
    """The new value of the cookie: a mark for this user is added, marks of other users are kept."""
    secret, until = new_secret(), int((now + KNOWN_FOR).timestamp())
    mark = f"{secret}~{until}~{_code(secret, until, password_hash)}"
    others = [mark for mark in cookie.split(_BETWEEN) if mark and not _fits(mark, password_hash)]
    return _BETWEEN.join([mark, *others][:MOST_USERS])


def key_of_browser(cookie: str, password_hash: str, now: datetime) -> str | None:
    """The key under which attempts of this browser are counted; ``None`` where the user with this
    password hash has not signed in there within ``KNOWN_FOR``."""
    for mark in cookie.split(_BETWEEN)[:MOST_USERS]:
        if _fits(mark, password_hash) and int(mark.split("~")[1]) > now.timestamp():
            return f"browser {digest_of(mark)}"
    return None


def _fits(mark: str, password_hash: str) -> bool:
    parts = mark.split("~")
    if len(parts) != 3 or not (parts[1].isascii() and parts[1].isdigit()) or len(parts[1]) > 12:
        return False
    return hmac.compare_digest(
        parts[2].encode("utf-8", "replace"), _code(parts[0], int(parts[1]), password_hash).encode()
    )


def _code(secret: str, until: int, password_hash: str) -> str:
    text = f"{secret} {until}".encode("utf-8", "replace")
    return hmac.new(_USE + password_hash.encode(), text, "sha256").hexdigest()
