"""Secrets that let somebody in: made at random, kept as digests only."""

from __future__ import annotations

import hashlib
import secrets

BYTES = 32  # 256 bits: nobody guesses one, so that a plain digest is enough to keep


def new_secret() -> str:
    """A new secret of 256 random bits, in letters that an address may hold."""
    return secrets.token_urlsafe(BYTES)


def digest_of(secret: str) -> str:
    """The SHA-256 of a secret in hexadecimal; what the store keeps and looks for."""
    return hashlib.sha256(secret.encode("utf-8", "replace")).hexdigest()
