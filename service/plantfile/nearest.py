"""Which known word somebody may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def nearest(word: str, known: Iterable[str]) -> str:
    """``" (did you mean 'zone'?)"``, or nothing where no known word comes close."""
    by_lower = {name.lower(): name for name in sorted(known)}
    close = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.6)
    return f" (did you mean {by_lower[close[0]]!r}?)" if close else ""


def either_of(known: Iterable[str]) -> str:
    """``"one of area, id, source"``."""
    return "one of " + ", ".join(sorted(known))
