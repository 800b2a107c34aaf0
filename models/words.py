"""Numbers as sentences have them."""

from __future__ import annotations


def share(part: float, digits: int = 0) -> str:
    """A share of one in percent: ``share(0.818)`` is "82 %"."""
    return f"{100.0 * part:.{digits}f} %"
