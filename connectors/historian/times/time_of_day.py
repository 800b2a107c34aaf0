"""A time column that holds the time of day without its date."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stemwatch.connectors.historian.raw_table import Index
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.time_fields import Ints, Order, time_fields
from stemwatch.connectors.historian.times.time_formats import is_clock_only
from stemwatch.models.recording import Bools

NO_DATE = "The times have no date."
_LOOKED_AT = 200
_DAY_NS = 86_400_000_000_000


def are_times_of_day(texts: Sequence[str]) -> bool:
    """Whether the first texts are times of day and no dates."""
    probe = [text for text in texts[:_LOOKED_AT] if text]
    return bool(probe) and sum(map(is_clock_only, probe)) > 0.8 * len(probe)


def times_of_day(
    texts: Sequence[str], groups: Sequence[Index | None], column: str, notes: ReadingNotes
) -> tuple[Ints, Bools]:
    """(n,) nanoseconds since the midnight before the first row, and which texts are times."""
    fields = time_fields([f"1970-01-01 {text}" for text in texts])
    ok = fields.order != Order.UNREADABLE
    by_minute = " (hours and minutes)" if all(text.count(":") == 1 for text in texts) else ""
    return past_midnight(fields.day_ns, ok, groups, column, by_minute, notes), ok


def past_midnight(
    day_ns: Ints,
    ok: Bools,
    groups: Sequence[Index | None],
    column: str,
    by_minute: str,
    notes: ReadingNotes,
) -> Ints:
    """(n,) nanoseconds since the midnight before the first row, of times of day.

    A step back by more than half a day, within the rows of a group (``None``: all rows), is
    midnight; in a file that runs backward a step forward.
    """
    ns = day_ns.copy()
    midnights = 0
    for group in groups:
        rows = np.flatnonzero(ok) if group is None else np.asarray(group)[ok[group]]
        steps = np.diff(ns[rows], prepend=ns[rows][:1])
        days = np.cumsum((steps < -_DAY_NS // 2).astype(np.int64) - (steps > _DAY_NS // 2))
        ns[rows] += days * _DAY_NS
        midnights = max(midnights, int(np.ptp(days)) if days.size else 0)
    passed = f", past {midnights} midnights" if midnights > 1 else ", past midnight"
    notes.decide(
        f"Column {column!r} holds the time of day{by_minute} without a date"
        f"{passed if midnights else ''}: durations are right, but a hole of half a day or more "
        "would not be seen."
    )
    return ns
