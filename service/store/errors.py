"""``StoreError``: what the store raises."""

from __future__ import annotations


class StoreError(Exception):
    """The store could not be opened, read or written. The text names the store (passwords
    masked), what happened and what to do."""


class NotThere(StoreError):
    """What was asked for by its number is not in the store."""


class Unstorable(StoreError):
    """What was to be written can never be stored, because a column takes no such value."""
