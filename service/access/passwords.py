"""Passwords: requirements, and argon2id hashes.

argon2id with 64 MiB, three passes and four lanes, the second choice of RFC 9106 (section 4). At
most two hashes are computed at a time, so that many sign-ins at once cannot fill the memory.
"""

from __future__ import annotations

import threading
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from stemwatch.service.store.accounts.users import name_key

SHORTEST, LONGEST = 12, 200
FEWEST_CHARACTERS = 5
_MOST_AT_ONCE, _LONGEST_WAIT_S = 2, 10.0
_HASHER = PasswordHasher(
    time_cost=3, memory_cost=64 * 1024, parallelism=4, hash_len=32, salt_len=16
)
_HASHING_SLOTS = threading.BoundedSemaphore(_MOST_AT_ONCE)
# Hash of an unused password: checking it makes an unknown name take as long as a known one.
UNUSED_HASH = (
    "$argon2id$v=19$m=65536,t=3,p=4$QNSI6KqEqQio6CQb6C4UFA"
    "$VKLNqmmLjHyOvZIF4gwZvabUFL3L9w8SHfxgtPcidSI"
)
_OF_ARGON2 = "$argon2"
_KNOWN = ("password", "passwort", "stemwatch", "qwerty", "qwertz", "123456", "abcdef", "letmein")


class WeakPassword(ValueError):
    """The password is not accepted; the text says what is expected."""


class Busy(Exception):
    """Too many passwords are being checked at the same time."""


def check_password(password: str, name: str) -> None:
    """Raise ``WeakPassword`` where a password is too short, too long, or easily guessed."""
    normal_form = _normal(password)
    # Normalising may lengthen a text: both lengths must be within the limits.
    if (
        min(len(normal_form), len(password)) < SHORTEST
        or max(len(normal_form), len(password)) > LONGEST
    ):
        raise WeakPassword(
            f"a password of {SHORTEST} to {LONGEST} characters is expected; several words are easy "
            "to keep in mind"
        )
    folded = name_key(normal_form)
    remainder = folded.replace(name_key(name), "") if name_key(name) else folded
    for word in _KNOWN:
        remainder = remainder.replace(word, "")
    if len(set(folded)) < FEWEST_CHARACTERS or len(remainder) < SHORTEST // 2:
        raise WeakPassword(
            "this password is easily guessed: it is little more than the name, one of the usual "
            "words, or a few characters again and again"
        )


def hash_password(password: str) -> str:
    """The hash with its salt and parameters. Raises ``Busy``."""
    with _hashing_slot():
        return _HASHER.hash(_normal(password))


def matches(password: str, stored: str | None) -> bool:
    """Whether ``password`` matches the hash ``stored``; takes the same time for ``None``, and for a
    user without a password. Raises ``Busy``."""
    hashed = stored if stored is not None and stored.startswith(_OF_ARGON2) else None
    with _hashing_slot():
        try:
            right = _HASHER.verify(hashed or UNUSED_HASH, _normal(password))
        except (VerificationError, InvalidHashError):
            return False
    return right and hashed is not None


def needs_rehash(stored: str) -> bool:
    """Whether a hash was made with other parameters than the present ones."""
    return _HASHER.check_needs_rehash(stored)


@contextmanager
def _hashing_slot() -> Iterator[None]:
    if not _HASHING_SLOTS.acquire(timeout=_LONGEST_WAIT_S):
        raise Busy("many people are signing in at once; try again in a moment")
    try:
        yield
    finally:
        _HASHING_SLOTS.release()


def _normal(password: str) -> str:
    """The password in Unicode NFKC, as NIST SP 800-63B requires, so that the keyboard does not
    matter."""
    return unicodedata.normalize("NFKC", password)
