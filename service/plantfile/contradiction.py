"""Two values that are right by themselves and not together."""

from __future__ import annotations

from pydantic_core import PydanticCustomError

KIND = "contradiction"


def contradiction(key: tuple[str, ...], found: str, expected: str) -> PydanticCustomError:
    """To be raised by a validator; ``key`` is where to look, from the table that is checked."""
    context = {"key": key, "found": found, "expected": expected}
    return PydanticCustomError(KIND, "found {found}; expected {expected}", context)
