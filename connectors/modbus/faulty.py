"""``Mistake``: values of a table that are right by themselves and not together."""

from __future__ import annotations


class Mistake(Exception):
    """What is wrong at ``key`` of a table, as the two halves of a sentence."""

    def __init__(self, key: str, found: str, expected: str) -> None:
        self.key, self.found, self.expected = key, found, expected
        super().__init__(f"{key}: found {found}; expected {expected}")
