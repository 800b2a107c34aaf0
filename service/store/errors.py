"""``StoreError``: the one error that the store raises."""

from __future__ import annotations


class StoreError(Exception):
    """The store could not be opened, read or written. The text names the store (passwords
    masked), what happened and what to do."""
