"""Local times to UTC, including the two hours a year that are ambiguous or do not exist; and the
end of summer time in a file whose times say neither zone nor offset."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.options import AmbiguousHour, MissingHour
from stemwatch.connectors.historian.raw_table import Index
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.models.recording import Bools
from stemwatch.models.words import counted

_MINUTE_NS = 60_000_000_000
_HOUR_NS = 60 * _MINUTE_NS
_DAY_NS = 24 * _HOUR_NS
_ROWS_AT_ONCE = 1 << 20


def to_utc(
    local: Ints,
    ok: Bools,
    zone: str,
    *,
    ambiguous_hour: AmbiguousHour,
    missing_hour: MissingHour,
    groups: Sequence[Index | None],
    notes: ReadingNotes,
) -> tuple[Ints, Bools]:
    """UTC nanoseconds of local ones in ``zone``, and which rows could be placed. They are written
    over ``local``: a large export has hundreds of MB of them.

    ``groups`` are the rows of each series in file order (``None``: all rows); the repeated hour
    is told apart within each of them, by the one step backwards between its two passes. Raises
    ``KeepsStandardTime``.
    """
    repeated, missing = (np.zeros(local.size, dtype=bool) for _ in range(2))
    passes: list[tuple[Ints, Ints]] = []  # of repeated rows, in order: first and second
    for first in range(0, local.size, _ROWS_AT_ONCE):
        part = slice(first, first + _ROWS_AT_ONCE)
        early, late, missing[part] = _both_passes(local[part], ok[part], zone)
        repeated[part] = twice = (early != late) & ok[part] & ~missing[part]
        passes.append((early[twice], late[twice]))
        # Rows of these two hours stay in local time for the checks below.
        local[part] = np.where(twice | missing[part], local[part], early)
    is_placed = ok & ~missing
    if repeated.any():
        notes.use("ambiguous_hour")
        summer, is_decided = _told_apart(local, repeated, ok, ambiguous_hour, groups)
        early, late = (np.concatenate(each) for each in zip(*passes, strict=True))
        local[repeated] = np.where(summer[repeated], early, late)
        is_placed &= is_decided | ~repeated
        _report_repeated(repeated, is_decided, ambiguous_hour, zone, notes)
    if missing.any():
        notes.use("missing_hour")
        is_placed = _shift(local, missing, is_placed, zone, missing_hour, groups, notes)
    local[~is_placed] = 0
    return local, is_placed


def _both_passes(local: Ints, ok: Bools, zone: str) -> tuple[Ints, Ints, Bools]:
    """UTC of each row, were it in the first or the second pass of a repeated hour; and which rows
    lie in an hour that is skipped."""
    import pandas as pd

    index = pd.DatetimeIndex(np.where(ok, local, 0).astype("datetime64[ns]"))
    all_rows = np.ones(local.size, dtype=bool)
    early = index.tz_localize(zone, ambiguous=all_rows, nonexistent="NaT")
    late = index.tz_localize(zone, ambiguous=~all_rows, nonexistent="NaT")
    return _ns(early), _ns(late), np.asarray(early.isna()) & ok


def _ns(index: object) -> Ints:
    import pandas as pd

    assert isinstance(index, pd.DatetimeIndex)
    utc = index.tz_convert("UTC").tz_localize(None).as_unit("ns")
    return np.asarray(utc.to_numpy().astype("datetime64[ns]").astype(np.int64))


def _told_apart(
    local: Ints,
    repeated: Bools,
    ok: Bools,
    policy: AmbiguousHour,
    groups: Sequence[Index | None],
) -> tuple[Bools, Bools]:
    """Which repeated rows are in summer time, and which rows could be told at all."""
    summer = np.full(local.size, policy == "first")
    is_decided = np.full(local.size, policy != "infer")
    if policy != "infer":
        return summer, is_decided
    for group in groups:
        rows = np.flatnonzero(repeated) if group is None else group[repeated[group]]
        rows = rows[ok[rows]]
        days = local[rows] // _DAY_NS
        for day in np.unique(days):
            _infer(local, rows[days == day], summer, is_decided)
    return summer, is_decided


def _infer(local: Ints, rows: Index, summer: Bools, is_decided: Bools) -> None:
    """One autumn night of one series: two passes are told apart by the step between them."""
    steps = np.diff(local[rows])
    backwards = np.flatnonzero(steps < 0)
    newest_first = steps.size > 1 and (steps < 0).sum() > (steps > 0).sum()
    turns = np.flatnonzero(steps > 0) if newest_first else backwards
    if turns.size == 1:
        passed = np.arange(rows.size) > turns[0]
        summer[rows] = passed if newest_first else ~passed
        is_decided[rows] = True


def _report_repeated(
    repeated: Bools, is_decided: Bools, policy: AmbiguousHour, zone: str, notes: ReadingNotes
) -> None:
    n = int(repeated.sum())
    lost = int((repeated & ~is_decided).sum())
    if policy != "infer":
        season = "summer time" if policy == "first" else "standard time"
        rows = _rows(n, "in the hour that autumn repeats", "taken")
        notes.decide(f"{rows} as {season}, as said.")
    elif n > lost:
        notes.decide(
            f"{_rows(n - lost, f'in the hour that autumn repeats in {zone}', 'told apart')} by "
            "their order: a clock change, not an event of the plant."
        )
    if lost:
        notes.decide(
            f"{_rows(lost, f'in the hour that autumn repeats in {zone}', 'left out')}: the hour is "
            "not there twice and in order. Say ambiguous_hour='first' or 'second' to use them."
        )


def _rows(count: int, place: str, done: str) -> str:
    """How many rows with times in ``place`` something was done with."""
    return counted(count, f"row {place} was {done}", f"rows {place} were {done}")


def _shift(
    local: Ints,
    missing: Bools,
    is_placed: Bools,
    zone: str,
    policy: MissingHour,
    groups: Sequence[Index | None],
    notes: ReadingNotes,
) -> Bools:
    """Which rows are placed, with those of the skipped hour moved by as much as is skipped: half an
    hour on Lord Howe Island."""
    n = int(missing.sum())
    if policy == "leave_out":
        left_out = _rows(n, f"in the hour that spring skips in {zone}", "left out")
        notes.decide(f"{left_out}, as said.")
        return is_placed
    import pandas as pd

    skipped = pd.DatetimeIndex(local[missing].astype("datetime64[ns]"))
    before = skipped.tz_localize(zone, ambiguous=True, nonexistent="shift_backward")
    winter = before.tz_localize(None).as_unit("ns").to_numpy().astype(np.int64) - _ns(before)
    after = skipped.tz_localize(zone, ambiguous=True, nonexistent="shift_forward")
    summer = after.tz_localize(None).as_unit("ns").to_numpy().astype(np.int64) - _ns(after)
    local[missing] -= winter
    _refuse_without_summer_time(local, missing, is_placed, zone, groups, int(winter[0]))
    hours = duration_in_words(int((summer - winter)[0]))
    notes.decide(
        f"{n} rows have times in the hour that spring skips in {zone}; they were shifted forward "
        f"by {hours}. If the source keeps standard time all year, give its fixed zone instead"
        f"{_fixed_zone(int(winter[0]))}."
    )
    return is_placed | missing


def duration_in_words(ns: int) -> str:
    """By how much clocks are put forward: an hour nearly everywhere."""
    return "an hour" if ns == _HOUR_NS else f"{ns // _MINUTE_NS} minutes"


def _fixed_zone(east_ns: int) -> str:
    """The zone without summer time that is so far east, as the end of a sentence; empty where there
    is none of whole hours."""
    hours, rest = divmod(east_ns, _HOUR_NS)
    return "" if rest else f", {f'Etc/GMT{-hours:+d}' if hours else 'UTC'!r}"


class KeepsStandardTime(UnreadableSource):
    """The clock of the source was not put forward in spring, as its zone would have it."""


def _refuse_without_summer_time(
    utc: Ints,
    missing: Bools,
    is_placed: Bools,
    zone: str,
    groups: Sequence[Index | None],
    winter_ns: int,
) -> None:
    """Raise ``KeepsStandardTime`` where rows of the skipped hour, put where they belong, fall among
    rows of the hour after it: that clock went on evenly, so that what follows is an hour wrong."""
    for group in groups:
        rows = slice(None) if group is None else group
        skipped, others = utc[rows][missing[rows]], utc[rows][is_placed[rows] & ~missing[rows]]
        for day in np.unique(skipped // _DAY_NS):
            night = skipped[skipped // _DAY_NS == day]
            if ((others >= night.min()) & (others <= night.max())).any():
                raise KeepsStandardTime(
                    f"its rows go on through the hour that spring skips in {zone}: its clock keeps "
                    "standard time, and every time in summer would be wrong. Give its fixed zone "
                    f"instead{_fixed_zone(winter_ns)}"
                )


def after_clock_change(
    ns: Ints, ok: Bools, groups: Sequence[Index | None], notes: ReadingNotes
) -> Ints:
    """``ns`` (n,) with what follows the end of summer time an hour later, so that the two passes of
    the repeated hour do not fall on each other; in place, within the rows of each group (``None``:
    all rows). ``ok`` (n,) are the rows that have a time.
    """
    put_back, all_dated = False, bool(ok.all())
    for group in groups:
        rows: slice | Index = slice(None)  # which costs a large file no memory
        if group is not None:
            rows = group if all_dated else group[ok[group]]
        elif not all_dated:
            rows = np.flatnonzero(ok)
        local = ns[rows]
        newest_first = bool(local.size) and local[0] > local[-1]
        in_order = local[::-1] if newest_first else local
        at = _clock_put_back(in_order)
        if at is not None:
            in_order[at:] += _HOUR_NS
            ns[rows] = local
            put_back = True
    if put_back:
        notes.decide(
            "The times step back by an hour once and go on evenly, as at the end of summer time: "
            "the rows after it are taken as an hour later. Give the zone where that is wrong."
        )
    return ns


def _clock_put_back(ns: Ints) -> int | None:
    """The row before which the clock was put back by an hour; ``None`` where it was not once."""
    steps = np.diff(ns)
    backward = np.flatnonzero(steps < 0)
    if backward.size != 1:
        return None
    at = int(backward[0])
    step, median_step = int(steps[at]), float(np.median(np.abs(steps, out=steps)))
    goes_on_evenly = abs(step + _HOUR_NS - median_step) <= median_step + 1e9
    return at + 1 if goes_on_evenly else None
