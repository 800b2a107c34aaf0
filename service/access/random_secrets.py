"""Random secrets of cookies, links and tokens, and the digests by which they are stored."""

from __future__ import annotations

import hashlib
import secrets

BYTES = 32  # 256 random bits cannot be guessed, so an unsalted digest is enough


def new_secret() -> str:
    """A new secret of 256 random bits, in characters that are safe in a URL."""
    return secrets.token_urlsafe(BYTES)


def digest_of(secret: str) -> str:
    """The SHA-256 of a secret in hexadecimal, as it is stored."""
    return hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()
