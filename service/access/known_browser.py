"""Browsers in which somebody has signed in before, known by a cookie of their own.

Whoever guesses at somebody's password makes the name wait, and without this its owner as well. A
browser in which the owner has signed in is counted by itself. Nothing is stored: the cookie bears a
code made with the stored hash of the password, so that a new password forgets every browser, and
nobody who lacks that hash can make one. It lets nobody in.
"""

from __future__ import annotations

import hmac
from datetime import datetime, timedelta

from stemwatch.service.access.secret import digest_of, new_secret

KNOWN_FOR = timedelta(days=90)
MOST_USERS = 8  # of one browser, in a control room
_BETWEEN = "."
_USE = b"stemwatch known browser"


def remember_browser(cookie: str, password_hash: str, now: datetime) -> str:
    """What the cookie holds from now on, beside what it holds of other users."""
    secret, until = new_secret(), int((now + KNOWN_FOR).timestamp())
    mark = f"{secret}~{until}~{_code(secret, until, password_hash)}"
    others = [mark for mark in cookie.split(_BETWEEN) if mark and not _fits(mark, password_hash)]
    return _BETWEEN.join([mark, *others][:MOST_USERS])


def key_of_browser(cookie: str, password_hash: str, now: datetime) -> str | None:
    """Under which attempts of this browser are counted; ``None`` where the user of this password
    has not signed in there, or not for long."""
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
