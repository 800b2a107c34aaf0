"""Shares and counts as text for sentences."""

from __future__ import annotations


def share(part: float, digits: int = 0) -> str:
    """A share of one in percent: ``share(0.818)`` is "82 %"."""
    return f"{100.0 * part:.{digits}f} %"


def times(count: int) -> str:
    """How often: "0 times", "once", "3 times"."""
    return {0: "0 times", 1: "once"}.get(count, f"{count} times")


def only_times(count: int) -> str:
    """How seldom: "0 times", "only once", "only 3 times"."""
    return f"only {times(count)}" if count else times(count)
