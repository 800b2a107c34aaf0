"""Which number of ``01/02/2026`` is the day: decided for a whole file or not at all."""

from __future__ import annotations

import numpy as np

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.time_fields import Ints, Order, TimeFields
from stemwatch.models.recording import Bools

_DAY_NS = 86_400_000_000_000
_YEARS = (1950, 2150)  # outside, a date is damage


def local_ns(
    fields: TimeFields, day_first: bool | None, name: str, example: str, notes: ReadingNotes
) -> tuple[Ints, Bools]:
    """(n,) nanoseconds since 1970 on the file's own clock, and which rows are real dates.

    Raises ``UnreadableSource`` where both orders of day and month make sense and differ.
    """
    numeric = fields.order == Order.NUMERIC
    if not numeric.any():
        return _instants(fields, fields.first, fields.second, fields.third)
    day, month = fields.first, fields.second
    chosen = _decide_order(fields, numeric, day_first, name, example, notes)
    if not chosen:
        day, month = month, day
    return _instants(
        fields,
        np.where(numeric, fields.third, fields.first),
        np.where(numeric, month, fields.second),
        np.where(numeric, day, fields.third),
    )


def _instants(fields: TimeFields, year: Ints, month: Ints, day: Ints) -> tuple[Ints, Bools]:
    full = np.where(fields.short_year == 1, year + np.where(year < 70, 2000, 1900), year)
    ok = (fields.order != Order.UNREADABLE) & (full >= _YEARS[0]) & (full <= _YEARS[1])
    ok &= (month >= 1) & (month <= 12) & (day >= 1)
    safe_month = np.where(ok, (full - 1970) * 12 + month - 1, 0).astype("datetime64[M]")
    first_day = safe_month.astype("datetime64[D]").astype(np.int64)
    length = (safe_month + 1).astype("datetime64[D]").astype(np.int64) - first_day
    ok &= day <= length
    days = np.where(ok, first_day + day - 1, 0)
    return np.where(ok, days * _DAY_NS + fields.day_ns, 0), ok


def _decide_order(
    fields: TimeFields,
    numeric: Bools,
    day_first: bool | None,
    name: str,
    example: str,
    notes: ReadingNotes,
) -> bool:
    """Whether the day stands first."""
    if day_first is not None:
        notes.decide(f"Dates such as {example} have the {_word(day_first)} first, as said.")
        return day_first
    a, b = fields.first[numeric], fields.second[numeric]
    day_a, day_b = int((a > 12).sum()), int((b > 12).sum())
    if bool(day_a) != bool(day_b):
        first = bool(day_a)
        notes.decide(
            f"Dates such as {example} have the {_word(first)} first: the day is above 12 in "
            f"{day_a or day_b} rows."
        )
        return first
    if day_a and day_b:
        return _majority(day_a, day_b, example, notes)
    if fields.dotted[numeric].all():
        notes.decide(f"Dates with points, such as {example}, have the day first.")
        return True
    return _decide_by_spacing(fields, a, b, name, example, notes)


def _word(day_first: bool) -> str:
    return "day" if day_first else "month"


def _majority(day_a: int, day_b: int, example: str, notes: ReadingNotes) -> bool:
    first = day_a >= day_b
    notes.problem(
        f"dates such as {example} change between day first ({day_a} rows) and month first "
        f"({day_b} rows); the rows of the rarer kind were left out where they make no date"
    )
    return first


def _decide_by_spacing(
    fields: TimeFields, a: Ints, b: Ints, name: str, example: str, notes: ReadingNotes
) -> bool:
    """The reading under which the rows are evenly spaced, where only one is."""
    if np.array_equal(a, b):
        notes.decide(f"Dates such as {example} are the same with day or month first.")
        return True
    even = {
        True: _even(_instants(fields, fields.third, fields.second, fields.first)),
        False: _even(_instants(fields, fields.third, fields.first, fields.second)),
    }
    if even[True] != even[False]:
        chosen = even[True]
        notes.decide(
            f"Dates such as {example} have the {_word(chosen)} first: only so are the rows "
            "evenly spaced."
        )
        return chosen
    raise UnreadableSource(
        f"{name}: dates such as {example!r} can be read with the day or the month first, and "
        "nothing in the file settles it; say day_first=True or day_first=False (--day-first or "
        "--month-first on the command line)"
    )


def _even(reading: tuple[Ints, Bools]) -> bool:
    """In order, over more than one day, and no step longer than an hour or ten usual steps."""
    ns, ok = reading
    times = ns[ok]
    steps = np.diff(times)
    if not ok.all() or steps.size < 2 or not (steps >= 0).all():
        return False
    crosses_midnight = times[0] // _DAY_NS != times[-1] // _DAY_NS
    median_step = float(np.median(steps))
    return bool(crosses_midnight and steps.max() <= max(10.0 * median_step, 3600e9))
