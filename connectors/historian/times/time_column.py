"""The time column as a whole: the instant of every row, whatever its text is."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.day_month_order import local_ns
from stemwatch.connectors.historian.times.instants import (
    SECOND_NS,
    Instants,
    in_zone,
    parts,
    rows_of_tags,
)
from stemwatch.connectors.historian.times.numeric_times import SAY_INTERVAL, numeric_instants
from stemwatch.connectors.historian.times.row_spacing import (
    Spread,
    at_interval,
    evenly_within_stamps,
)
from stemwatch.connectors.historian.times.time_fields import (
    NO_OFFSET,
    Ints,
    Order,
    stored_time_fields,
    time_fields,
)
from stemwatch.connectors.historian.times.time_of_day import (
    NO_DATE,
    are_times_of_day,
    past_midnight,
    times_of_day,
)
from stemwatch.connectors.historian.times.zones import KeepsStandardTime
from stemwatch.connectors.historian.values.numbers import parse_numbers
from stemwatch.connectors.historian.values.stored_text import (
    StoredText,
    cells_at,
    neighbours_once,
)
from stemwatch.models.recording import Bools

_DAY_NS = 86_400_000_000_000
_YEAR_IN_FORMAT = re.compile(r"%[YyGcx]|^(?:mixed|ISO8601)$")
_DATE_IN_FORMAT = re.compile(r"%[YyGcxmdbBjUWV]|^(?:mixed|ISO8601)$")
_LOOKED_AT = 20_000  # rows of a large file that show whether it repeats its rows


def read_instants(
    table: RawTable, options: ReadOptions, name: str, notes: ReadingNotes
) -> Instants:
    """The time of every row of ``table``. Rows without a readable time are reported.

    Raises ``UnreadableSource`` where no row has one, or nothing tells the interval.
    """
    times = table.times
    if times.texts is None:
        return _row_count_instants(table, options, name, notes)
    try:
        instants = _written(table, options, name, notes)
    except KeepsStandardTime as error:
        raise KeepsStandardTime(f"{name}: {error}") from None
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
        ns, ok = times_of_day(list(texts), rows_of_tags(table), table.times.name, notes)
        instants = Instants(ns=ns, ok=ok, in_utc=False, zone=NO_DATE)
    else:
        instants = numeric_instants(texts, table, options, notes)
    if instants is None:
        instants = _dated(texts, table, options, name, notes)
    if not instants.ok.any() and "ambiguous_hour" in notes.used:
        raise UnreadableSource(
            f"{name}: all rows lie in the hour that autumn repeats in {options.zone}, and nothing "
            'tells in which of the two. Say ambiguous_hour = "first" or "second" for this source '
            "in the plant file"
        )
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
            f"{SAY_INTERVAL}"
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
        advice = "" if dated else f". If it is the other, {SAY_INTERVAL}"
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
            f"{SAY_INTERVAL}, or time_column (--time-column) if a column holds the time"
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
    if not _DATE_IN_FORMAT.search(time_format):
        of_day = np.where(ok, ns % _DAY_NS, 0)
        ns = past_midnight(of_day, ok, rows_of_tags(table), table.times.name, "", notes)
        return Instants(ns=ns, ok=ok, in_utc=False, zone=NO_DATE)
    if not _YEAR_IN_FORMAT.search(time_format):
        sentence = "The format names no year: durations are right, the date is not known."
        notes.decide(sentence)
        return Instants(ns=ns, ok=ok, in_utc=False, zone=sentence)
    if aware:
        sentence = "Each time carries its offset from UTC."
        notes.decide(sentence)
        return Instants(ns=ns, ok=ok, in_utc=True, zone=sentence)
    return in_zone(ns, ok, np.full(ns.size, NO_OFFSET, dtype=np.int64), table, options, notes)


def _dated(
    texts: Sequence[str], table: RawTable, options: ReadOptions, name: str, notes: ReadingNotes
) -> Instants:
    if isinstance(texts, StoredText):
        in_pieces = _in_pieces(texts, name, notes)
        if in_pieces is not None:
            return in_zone(*in_pieces, table, options, notes)
        texts = list(texts)
    fields = time_fields(texts)
    if (fields.order == Order.NUMERIC).any():
        notes.use("day_first")
    readable = np.flatnonzero(fields.order != Order.UNREADABLE)
    example = texts[int(readable[0])] if readable.size else ""
    day_first = table.times.day_first if options.day_first is None else options.day_first
    ns, ok = local_ns(fields, day_first, name, example, notes)
    return in_zone(ns, ok, fields.offset_min, table, options, notes)


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
    for part in parts(ns.size):
        seconds[part] = (ns[part] - first) // SECOND_NS
    low, middle, high = np.percentile(seconds, (2.0, 50.0, 98.0), overwrite_input=True)
    reach = max(middle + 1.0, (last - first) / 1e9 - middle + 1.0)
    return bool(reach < 20.0 * (high - low - 1.0) + 86_400.0)


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
