"""Times that are numbers: Unix times, day numbers of a spreadsheet, seconds since a start, or a
count of the rows."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.instants import SECOND_NS, Instants, in_zone
from stemwatch.connectors.historian.times.row_spacing import counts_rows
from stemwatch.connectors.historian.times.time_fields import NO_OFFSET, Order, time_fields
from stemwatch.connectors.historian.values.numbers import parse_numbers
from stemwatch.models.recording import Bools, Floats

_MAX_SECONDS = 4e9  # s; larger relative times are not in seconds
# Epoch times between 1980 and 2100, by their unit.
_EPOCHS = (("seconds", 1e9), ("milliseconds", 1e6), ("microseconds", 1e3), ("nanoseconds", 1.0))
_EPOCH_SPAN_S = (315_532_800.0, 4_102_444_800.0)
_EXCEL_DAYS = (25_569.0, 73_050.0)
_UNIT_NS = {"ms": 1e6, "us": 1e3, "µs": 1e3, "ns": 1.0, "min": 60e9, "h": 3600e9, "d": 86400e9}
_UNIT = re.compile(r"(?:_|\(|\[|\s)(ms|us|µs|ns|min|h|d)\s*[\])]?$")
_SECONDS = re.compile(r"(?:^|[_(\[\s])(?:s|sec|secs|seconds?|sekunden)\s*[\])]?$", re.I)
SAY_INTERVAL = "say interval_s (--interval-s on the command line)"
_OR_ROWS = f" If it only counts rows, {SAY_INTERVAL}."
_DATE_NAME = re.compile(r"date|datum|stamp|zeit", re.I)


def numeric_instants(
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
        low, high = (bound * SECOND_NS / ns_each for bound in _EPOCH_SPAN_S)
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
        return in_zone(ns, ok, np.full(ns.size, NO_OFFSET, dtype=np.int64), table, options, notes)
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
