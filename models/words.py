"""Shares, counts and capitals for sentences."""

from __future__ import annotations

from collections.abc import Sequence


def share(part: float, digits: int = 0) -> str:
    """A share of one in percent: ``share(0.818)`` is "82 %"."""
    return f"{100.0 * part:.{digits}f} %"


def counted(count: int, one: str, several: str = "") -> str:
    """How many: ``counted(1, "row")`` is "1 row", ``counted(3, "row")`` "3 rows". ``several`` is
    said of any number but one where that is not ``one`` with an s."""
    return f"{count} {one}" if count == 1 else f"{count} {several or f'{one}s'}"


def listed(names: Sequence[str], most: int) -> str:
    """The first ``most`` of ``names``, and how many more there are: "A, B and 3 more"."""
    and_more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{and_more}"


def capitalised(text: str) -> str:
    """``text`` as the beginning of a sentence: names of tags within it stay as they are."""
    return f"{text[:1].upper()}{text[1:]}"


def times(count: int) -> str:
    """How often: "0 times", "once", "3 times"."""
    return {0: "0 times", 1: "once"}.get(count, f"{count} times")


def only_times(count: int) -> str:
    """How seldom: "0 times", "only once", "only 3 times"."""
    return f"only {times(count)}" if count else times(count)
