"""The time column as a whole: instants in nanoseconds, and what is known of their zone."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.raw_table import Index, RawTable
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.day_month_order import local_ns
from stemwatch.connectors.historian.times.row_spacing import (
    Spread,
    at_interval,
    counts_rows,
    evenly_within_stamps,
)
from stemwatch.connectors.historian.times.time_fields import (
    NO_OFFSET,
    Ints,
    Order,
    stored_time_fields,
    time_fields,
)
from stemwatch.connectors.historian.times.time_of_day import are_times_of_day, times_of_day
from stemwatch.connectors.historian.times.zones import after_clock_change, to_utc
from stemwatch.connectors.historian.values.numbers import parse_numbers
from stemwatch.connectors.historian.values.stored_text import (
    StoredText,
    cells_at,
    neighbours_once,
)
from stemwatch.models.recording import Bools, Floats

_ROWS_AT_ONCE = 1 << 20
_LOOKED_AT = 20_000  # rows of a large file that show whether it repeats its rows
_SECOND_NS = 1_000_000_000
_MAX_SECONDS = 4e9  # s; larger relative times are not in seconds
# Epoch times between 1980 and 2100, by their unit.
_EPOCHS = (("seconds", 1e9), ("milliseconds", 1e6), ("microseconds", 1e3), ("nanoseconds", 1.0))
_EPOCH_SPAN_S = (315_532_800.0, 4_102_444_800.0)
_EXCEL_DAYS = (25_569.0, 73_050.0)
_UNIT_NS = {"ms": 1e6, "us": 1e3, "µs": 1e3, "ns": 1.0, "min": 60e9, "h": 3600e9, "d": 86400e9}
_UNIT = re.compile(r"(?:_|\(|\[|\s)(ms|us|µs|ns|min|h|d)\s*[\])]?$")
_SECONDS = re.compile(r"(?:^|[_(\[\s])(?:s|sec|secs|seconds?|sekunden)\s*[\])]?$", re.I)
_SAY_INTERVAL = "say interval_s (--interval-s on the command line)"
_OR_ROWS = f" If it only counts rows, {_SAY_INTERVAL}."
_UTC_NAME = re.compile(r"(?:^|[^A-Za-z])(?:utc|gmt)(?:$|[^A-Za-z])", re.I)
_DATE_NAME = re.compile(r"date|datum|stamp|zeit", re.I)


@dataclass(frozen=True, kw_only=True)
class Instants:
    """(n,) nanoseconds: since 1970 UTC where ``in_utc``, else on a clock of unknown date."""

    ns: Ints
    ok: Bools
    in_utc: bool
    zone: str  # one sentence

    @property
    def shared(self) -> bool:
        """Whether most rows have the time of the row before."""
        return bool(self.ok.all() and self.ns.size > 1 and (np.diff(self.ns) == 0).mean() >= 0.4)


def read_instants(
    table: RawTable, options: ReadOptions, name: str, notes: ReadingNotes
) -> Instants:
    """The time of every row of ``table``. Rows without a readable time are reported.

    Raises ``UnreadableSource`` where no row has one, or nothing tells the interval.
    """
    times = table.times
    if times.texts is None:
        return _row_count_instants(table, options, name, notes)
    instants = _written(table, options, name, notes)
    if table.narrow:
        return _with_cut_stamps_of_tags(instants, table, notes)
    return _with_cut_stamps(instants, table, options, notes)


def _written(table: RawTable, options: ReadOptions, name: str, notes: ReadingNotes) -> Instants:
    """The instants that the time column holds."""
    time_texts = table.times.texts or ()
    texts = (
        time_texts if isinstance(time_texts, StoredText) else [text.strip() for text in time_texts]
    )
    instants = None
    if options.time_format is not None:
        notes.use("time_format")
        instants = _by_format(texts, options.time_format, table, options, name, notes)
    elif are_times_of_day(texts):
        ns, ok = times_of_day(list(texts), _groups(table), table.times.name, notes)
        instants = Instants(ns=ns, ok=ok, in_utc=False, zone="The times have no date.")
    else:
        instants = _numeric(texts, table, options, notes)
    if instants is None:
        instants = _dated(texts, table, options, name, notes)
    if not instants.ok.any():
        raise UnreadableSource(
            f"{name}: line {table.numbers[0] if table.numbers else 1}: no row has a time that can "
            f"be read; the first is {texts[0] if texts else ''!r}. Say time_format, or "
            "time_column if another column holds the time"
        )
    _report_unreadable(instants.ok, texts, table, notes)
    return _without_strays(_with_milliseconds(instants, table), texts, table, notes)


def _with_cut_stamps(
    instants: Instants, table: RawTable, options: ReadOptions, notes: ReadingNotes
) -> Instants:
    """The rows between two equal stamps, spaced as the user, the file or their numbers say."""
    column = table.times.name
    shared = instants.shared and not _repeated_rows(table)
    for interval_s, origin in (
        (options.interval_s, "as given"),
        (table.interval_s, "as the file says"),
    ):
        spaced = (
            None
            if interval_s is None or not shared
            else at_interval(instants.ns, instants.ok, interval_s)
        )
        if spaced is None:
            continue
        if origin == "as given":
            notes.use("interval_s")
        notes.decide(
            f"The rows are {interval_s:g} s apart, {origin}; column {column!r} gives the same time "
            "to several of them, as a spreadsheet does that cuts times."
        )
        return replace(instants, ns=spaced)
    spread = evenly_within_stamps(instants.ns, instants.ok) if shared else None
    if spread is not None:
        notes.decide(_cut_sentence(column, spread))
        instants = replace(instants, ns=spread.ns)
    elif shared:
        notes.problem(
            f"column {column!r} gives most rows the time of the row before, and not evenly; of "
            "these only the last is kept. Export with seconds, or "
            f"{_SAY_INTERVAL}"
        )
    _compare_with_file(instants, table, notes)
    return instants


def _with_cut_stamps_of_tags(instants: Instants, table: RawTable, notes: ReadingNotes) -> Instants:
    """The same for a row per sample, where each tag has stamps of its own."""
    ns, repeated = instants.ns, None
    for column in table.columns:
        rows = slice(None) if column.rows is None else column.rows
        spread = evenly_within_stamps(instants.ns[rows], instants.ok[rows])
        if spread is None:
            continue
        if repeated is None:  # decided by one tag: each further one would read a large file again
            repeated = _repeated([_some_cells(column.cells)])
        if repeated:
            break
        notes.decide(_cut_sentence(table.times.name, spread))
        ns = ns.copy() if ns is instants.ns else ns
        ns[rows] = spread.ns
    return replace(instants, ns=ns)


def _cut_sentence(column: str, spread: Spread) -> str:
    return (
        f"Column {column!r} gives the same time to {spread.each} rows in a row, as a spreadsheet "
        f"does that cuts times; the rows are taken as {spread.interval_s:g} s apart."
    )


def _compare_with_file(instants: Instants, table: RawTable, notes: ReadingNotes) -> None:
    """Report where a column with the sampling interval contradicts the times used."""
    steps = np.diff(instants.ns[instants.ok])
    if table.interval_s is None or not steps.size:
        return
    step_s = float(np.median(steps)) / 1e9
    if abs(step_s - table.interval_s) > 0.05 * table.interval_s:
        says = f"column {table.interval_name!r} says {table.interval_s:g} s between rows, "
        if "interval_s" in notes.used:
            notes.problem(f"{says}interval_s {step_s:g} s; interval_s was taken")
            return
        dated = instants.in_utc or bool(instants.zone)
        advice = "" if dated else f". If it is the other, {_SAY_INTERVAL}"
        notes.problem(
            f"{says}column {table.times.name!r} {step_s:g} s; the times were taken{advice}"
        )


def _repeated_rows(table: RawTable) -> bool:
    """Whether rows mostly say what the row before says: the file has each row several times."""
    return _repeated([_some_cells(column.cells) for column in table.columns])


def _some_cells(cells: Sequence[str]) -> Sequence[str]:
    return cells.first(_LOOKED_AT) if isinstance(cells, StoredText) else cells


def _repeated(columns: Sequence[Sequence[str]]) -> bool:
    rows = list(zip(*columns, strict=True))
    repeat_count = sum(row == before for before, row in pairwise(rows))
    return repeat_count > 0.3 * len(rows)


def _row_count_instants(
    table: RawTable, options: ReadOptions, name: str, notes: ReadingNotes
) -> Instants:
    given, said = options.interval_s, table.interval_s
    interval_s = given or said
    notes.use("interval_s")
    if interval_s is None:
        raise UnreadableSource(
            f"{name}: there is no time column and nothing tells the interval of the rows; "
            f"{_SAY_INTERVAL}, or time_column (--time-column) if a column holds the time"
        )
    origin = "as given" if given else f"as column {table.interval_name!r} says"
    notes.decide(f"There is no time column; the rows are {interval_s:g} s apart, {origin}.")
    if given and said and abs(given - said) > 0.05 * said:
        notes.problem(
            f"column {table.interval_name!r} says {said:g} s between rows, interval_s {given:g} s; "
            "interval_s was taken"
        )
    n = len(table.numbers)
    ns = np.round(np.arange(n) * interval_s * 1e9).astype(np.int64)
    return Instants(ns=ns, ok=np.ones(n, dtype=bool), in_utc=False, zone="")


def _numeric(
    texts: Sequence[str], table: RawTable, options: ReadOptions, notes: ReadingNotes
) -> Instants | None:
    """Epoch times, Excel day numbers or seconds since the start; ``None`` where texts are dates."""
    probe = [text for text in texts[:200] if text]
    if not probe or np.isfinite(parse_numbers(probe, ".")).mean() < 0.8:
        decimal = "," if probe and np.isfinite(parse_numbers(probe, ",")).mean() >= 0.8 else ""
        if not decimal:
            return None
    else:
        decimal = "."
    if len(probe[0]) == 14 and time_fields(probe[:1]).order[0] != Order.UNREADABLE:
        return None
    numbers = parse_numbers(texts, decimal)
    ok = np.isfinite(numbers)
    middle = float(np.median(numbers[ok]))
    for unit, ns_each in _EPOCHS:
        low, high = (bound * _SECOND_NS / ns_each for bound in _EPOCH_SPAN_S)
        if low <= middle <= high:
            notes.decide(f"The times are Unix {unit}, in UTC.")
            return _epoch(texts, numbers, ok & (numbers >= low) & (numbers <= high), ns_each)
    return _relative(numbers, ok, table, options, notes)


def _epoch(texts: Sequence[str], numbers: Floats, ok: Bools, ns_each: float) -> Instants:
    whole_numbers = np.floor(np.where(ok, numbers, 0.0))
    fraction = np.where(ok, numbers, 0.0) - whole_numbers
    # A double holds 2**53 exactly; nanoseconds since 1970 need integers of their own. With a point
    # or an exponent the file itself has no more than a double: right to 256 ns.
    if ns_each == 1.0:
        rows = zip(texts, ok.tolist(), whole_numbers.tolist(), strict=True)
        whole_ns = np.array(
            [int(text) if good and text.isdecimal() else int(whole) for text, good, whole in rows],
            dtype=np.int64,
        )
    else:
        whole_ns = whole_numbers.astype(np.int64) * int(ns_each)
    ns = whole_ns + np.round(fraction * ns_each / 1e3).astype(np.int64) * 1000
    return Instants(ns=ns, ok=ok, in_utc=True, zone="The times are Unix times, in UTC.")


def _relative(
    numbers: Floats, ok: Bools, table: RawTable, options: ReadOptions, notes: ReadingNotes
) -> Instants:
    header = table.times.name
    if _are_excel_days(numbers[ok], header):
        return _excel_days(numbers, ok, table, options, notes)
    unit = _UNIT.search(header)
    scale = _UNIT_NS[unit[1]] if unit else 1e9
    ok = ok & (np.abs(numbers) < _MAX_SECONDS * 1e9 / scale)
    spaced_instants = _spaced(numbers, ok, scale, table, options, notes)
    if spaced_instants is not None:
        return spaced_instants
    named = unit[1] if unit else "seconds"
    unsure = "" if unit or _SECONDS.search(header) or not counts_rows(numbers[ok]) else _OR_ROWS
    notes.decide(
        f"The numbers of column {header!r} are {named} since a start that the file does not date."
        f"{unsure}"
    )
    ns = np.round(np.where(ok, numbers, 0.0) * scale).astype(np.int64)
    return Instants(ns=ns, ok=ok, in_utc=False, zone="")


def _spaced(
    numbers: Floats,
    ok: Bools,
    scale: float,
    table: RawTable,
    options: ReadOptions,
    notes: ReadingNotes,
) -> Instants | None:
    """Rows as far apart as the user or a column of the file says, where ``numbers`` only count
    them or are not what the user says they are; ``None`` where the numbers are times."""
    if table.narrow:
        return None
    header, interval_s = table.times.name, options.interval_s
    is_counter = counts_rows(numbers[ok])
    if interval_s is not None:
        steps = np.diff(numbers[ok])
        notes.use("interval_s")
        if (
            steps.size
            and abs(float(np.median(steps)) * scale - interval_s * 1e9) < 1e-6 * interval_s * 1e9
        ):
            return None  # the numbers agree, and also show missing rows
        reason = "only counts them" if is_counter else "is not used as time"
        notes.decide(f"The rows are {interval_s:g} s apart, as given; column {header!r} {reason}.")
        return _rows_apart(numbers, ok, interval_s, is_counter)
    if table.interval_s is None or not is_counter or _SECONDS.search(header):
        return None
    notes.decide(
        f"The rows are {table.interval_s:g} s apart, as column {table.interval_name!r} says; "
        f"column {header!r} only counts them."
    )
    return _rows_apart(numbers, ok, table.interval_s, is_counter)


def _rows_apart(numbers: Floats, ok: Bools, interval_s: float, is_counter: bool) -> Instants:
    """Rows at their number where they are counted, so that missing rows stay missing."""
    row_number = (
        np.where(ok, numbers - numbers[ok][0], 0.0) if is_counter else np.arange(numbers.size)
    )
    ns = np.round(row_number * (interval_s * 1e9)).astype(np.int64)
    return Instants(ns=ns, ok=ok if is_counter else np.ones_like(ok), in_utc=False, zone="")


def _excel_days(
    numbers: Floats, ok: Bools, table: RawTable, options: ReadOptions, notes: ReadingNotes
) -> Instants:
    ns = np.round((np.where(ok, numbers, 0.0) - _EXCEL_DAYS[0]) * 86_400e3).astype(np.int64)
    ns *= 1_000_000
    if options.zone is not None:
        notes.decide(f"The numbers of column {table.times.name!r} are Excel days.")
        return _in_zone(ns, ok, np.full(ns.size, NO_OFFSET, dtype=np.int64), table, options, notes)
    notes.decide(
        f"The numbers of column {table.times.name!r} are Excel days; their zone is not known."
    )
    return Instants(ns=ns, ok=ok, in_utc=False, zone="The times are Excel days without a zone.")


def _are_excel_days(numbers: Floats, header: str) -> bool:
    """Day numbers of 1970 to 2100 under a header that names a date, or in steps of minutes."""
    if not ((numbers >= _EXCEL_DAYS[0]) & (numbers <= _EXCEL_DAYS[1])).all():
        return False
    if _DATE_NAME.search(header):
        return True
    steps = np.abs(np.diff(numbers))
    return bool(header.strip().lower() == "time" and steps.size and np.median(steps) < 0.05)


def _by_format(
    texts: Sequence[str],
    time_format: str,
    table: RawTable,
    options: ReadOptions,
    name: str,
    notes: ReadingNotes,
) -> Instants:
    import pandas as pd

    aware = "%z" in time_format
    column = pd.Series(texts, dtype=object)
    try:
        index = pd.to_datetime(column, format=time_format, errors="coerce", utc=aware)
    except ValueError as error:
        raise UnreadableSource(
            f"{name}: time_format = {time_format!r} cannot be used ({error}); expected a format "
            "such as '%d.%m.%Y %H:%M:%S' (--time-format on the command line)"
        ) from None
    ok = np.asarray(index.notna())
    local = index.dt.tz_localize(None) if aware else index
    ns = local.dt.as_unit("ns").fillna(pd.Timestamp(0)).to_numpy().astype(np.int64)
    notes.decide(f"The times were read by the given format {time_format!r}.")
    offsets = np.full(ns.size, 0 if aware else NO_OFFSET, dtype=np.int64)
    return _in_zone(ns, ok, offsets, table, options, notes)


def _dated(
    texts: Sequence[str], table: RawTable, options: ReadOptions, name: str, notes: ReadingNotes
) -> Instants:
    if isinstance(texts, StoredText):
        in_pieces = _in_pieces(texts, name, notes)
        if in_pieces is not None:
            return _in_zone(*in_pieces, table, options, notes)
        texts = list(texts)
    fields = time_fields(texts)
    if (fields.order == Order.NUMERIC).any():
        notes.use("day_first")
    readable = np.flatnonzero(fields.order != Order.UNREADABLE)
    example = texts[int(readable[0])] if readable.size else ""
    day_first = table.times.day_first if options.day_first is None else options.day_first
    ns, ok = local_ns(fields, day_first, name, example, notes)
    return _in_zone(ns, ok, fields.offset_min, table, options, notes)


def _in_pieces(
    texts: StoredText, name: str, notes: ReadingNotes
) -> tuple[Ints, Bools, NDArray[np.int32]] | None:
    """Local nanoseconds, which rows are dates, and offsets, piece by piece; ``None`` where the
    order of day and month is for the whole column to tell."""
    size, rows_done = len(texts), 0
    ns, ok = np.empty(size, dtype=np.int64), np.empty(size, dtype=bool)
    # Mostly all rows have one offset, which then needs no memory.
    offsets = np.broadcast_to(np.int32(NO_OFFSET), size)
    for text in texts.arrays():
        # The tags of a row per sample share their times: each is read once.
        distinct, repeats = neighbours_once(text)
        fields = stored_time_fields(distinct)
        if (fields.order == Order.NUMERIC).any():
            return None
        local, real = local_ns(fields, None, name, "", notes)
        end = rows_done + len(text)
        if local.size and not rows_done:
            offsets = np.broadcast_to(np.int32(fields.offset_min[0]), size)
        if offsets.flags.writeable or (fields.offset_min != offsets[0]).any():
            offsets = offsets if offsets.flags.writeable else offsets.copy()
            offsets[rows_done:end] = np.repeat(fields.offset_min, repeats)
        ns[rows_done:end], ok[rows_done:end] = np.repeat(local, repeats), np.repeat(real, repeats)
        rows_done = end
    return ns, ok, offsets


def _groups(table: RawTable) -> list[Index | None]:
    """The rows of each tag where each has its own times; else all rows together."""
    return [column.rows for column in table.columns] if table.narrow else [None]


def _in_zone(
    ns: Ints,
    ok: Bools,
    offset_min: Ints | NDArray[np.int32],
    table: RawTable,
    options: ReadOptions,
    notes: ReadingNotes,
) -> Instants:
    """Instants from local nanoseconds and the offsets the rows carry, or the zone the user gave."""
    aware = ok & (offset_min != NO_OFFSET)
    naive = ok & ~aware  # which no offset moves
    if aware.any():
        for part in _parts(ns.size):
            east = np.where(aware[part], offset_min[part], 0).astype(np.int64)
            ns[part] -= east * (60 * _SECOND_NS)
    utc = ns
    if not naive.any():
        offsets = offset_min if ok.all() else offset_min[ok]
        return Instants(ns=utc, ok=ok, in_utc=True, zone=_offset_sentence(offsets, notes))
    if _UTC_NAME.search(table.times.name):
        notes.decide("The times are UTC by the name of their column.")
        return Instants(ns=utc, ok=ok, in_utc=True, zone="The times are written in UTC.")
    if options.zone is not None:
        notes.use("zone")
        return _localised(ns, utc, naive, aware, options.zone, table, options, notes)
    if aware.any():
        n = int(naive.sum())
        notes.problem(f"{n} times have no offset while others do, and no zone was given; left out")
        return Instants(
            ns=utc, ok=aware, in_utc=True, zone=_offset_sentence(offset_min[aware], notes)
        )
    return undated(after_clock_change(ns, ok, _groups(table), notes), ok, notes)


def undated(ns: Ints, ok: Bools, notes: ReadingNotes) -> Instants:
    """Local times of a zone that nobody gave: instants on a clock of unknown date."""
    zone = "The times have no zone and none was given: durations are right, the date is not known."
    notes.decide(zone)
    return Instants(ns=ns, ok=ok, in_utc=False, zone=zone)


def _localised(
    ns: Ints,
    utc: Ints,
    naive: Bools,
    aware: Bools,
    zone: str,
    table: RawTable,
    options: ReadOptions,
    notes: ReadingNotes,
) -> Instants:
    local_utc, is_placed = to_utc(
        ns if naive.all() else ns.copy(),
        naive,
        zone,
        ambiguous_hour=options.ambiguous_hour,
        missing_hour=options.missing_hour,
        groups=_groups(table),
        notes=notes,
    )
    sentence = f"Times without offset are local times of {zone}."
    notes.decide(sentence)
    ns = local_utc if naive.all() else np.where(naive, local_utc, utc)
    return Instants(ns=ns, ok=is_placed | aware, in_utc=True, zone=sentence)


def _offset_sentence(offset_min: Ints | NDArray[np.int32], notes: ReadingNotes) -> str:
    offsets = {m for part in _parts(offset_min.size) for m in np.unique(offset_min[part]).tolist()}
    distinct = [f"{m // 60:+03d}:{m % 60:02d}" if m >= 0 else f"-{-m // 60:02d}:{-m % 60:02d}"
                for m in sorted(offsets)]  # fmt: skip
    sentence = f"Each time carries its offset from UTC ({', '.join(distinct)})."
    notes.decide(sentence)
    return sentence


def _with_milliseconds(instants: Instants, table: RawTable) -> Instants:
    if table.times.milliseconds is None:
        return instants
    extra = np.nan_to_num(parse_numbers(table.times.milliseconds, "."))
    ns = instants.ns + np.round(np.clip(extra, 0, 999_999) * 1e6).astype(np.int64)
    return Instants(ns=ns, ok=instants.ok, in_utc=instants.in_utc, zone=instants.zone)


def _near_together(ns: Ints) -> bool:
    """Whether no row can be far from all others, found with whole seconds, which need less memory
    than ``_without_strays`` does."""
    first, last = int(ns.min()), int(ns.max())
    if last - first > 2e18:
        return False
    seconds = np.empty(ns.size, dtype=np.int32)
    for part in _parts(ns.size):
        seconds[part] = (ns[part] - first) // _SECOND_NS
    low, middle, high = np.percentile(seconds, (2.0, 50.0, 98.0), overwrite_input=True)
    reach = max(middle + 1.0, (last - first) / 1e9 - middle + 1.0)
    return bool(reach < 20.0 * (high - low - 1.0) + 86_400.0)


def _parts(size: int) -> Iterator[slice]:
    """Rows in order, so many at a time that what is made of them needs little memory."""
    for first in range(0, size, _ROWS_AT_ONCE):
        yield slice(first, first + _ROWS_AT_ONCE)


def _report_unreadable(
    ok: Bools, texts: Sequence[str], table: RawTable, notes: ReadingNotes
) -> None:
    if ok.all():
        return
    rows = np.flatnonzero(~ok)[:5]
    for row, text in zip(rows.tolist(), cells_at(texts, rows), strict=True):
        notes.problem(
            f"line {table.numbers[row]}: {text[:40]!r} is not a time that could be placed; "
            "the row was left out"
        )
    lost = int((~ok).sum())
    if lost > 5:
        notes.problem(f"{lost} rows in all have no time that could be placed")


def _without_strays(
    instants: Instants, texts: Sequence[str], table: RawTable, notes: ReadingNotes
) -> Instants:
    """Single rows dated years away from all others are damage, not a gap."""
    good = instants.ns if instants.ok.all() else instants.ns[instants.ok]
    if good.size < 100 or _near_together(good):
        return instants
    low, middle, high = np.percentile(good, (2.0, 50.0, 98.0))
    is_stray = np.abs(instants.ns - middle) > 20.0 * (high - low) + 86_400e9
    stray = instants.ok & is_stray
    if not stray.any():
        return instants
    first = int(np.flatnonzero(stray)[0])
    notes.problem(
        f"line {table.numbers[first]}: the time {texts[first]!r} is far from all others; "
        f"{int(stray.sum())} such rows were left out"
    )
    return Instants(
        ns=instants.ns, ok=instants.ok & ~stray, in_utc=instants.in_utc, zone=instants.zone
    )
