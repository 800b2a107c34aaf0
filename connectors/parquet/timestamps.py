"""Times of a Parquet column, of any type and resolution, to nanoseconds."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np

from stemwatch.connectors.archive.valve_columns import Bounds
from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.raw_table import RawTable, RawTimes
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.epoch import instant_of
from stemwatch.connectors.historian.times.instants import Instants, local_instants, undated
from stemwatch.connectors.historian.times.time_column import read_instants
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.models.recording import Bools

_UNIT_NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
# Daylight saving shifts local clocks by an hour, and an option may move a row by another hour.
_MARGIN_NS = 3 * 3_600_000_000_000


@dataclass(frozen=True, kw_only=True)
class Stamps:
    """(n,) nanoseconds, ``ok`` where there is a time, ``naive`` where they are local times."""

    ns: Ints
    ok: Bools
    naive: bool


def is_naive(schema: Any, name: str) -> bool:
    """Whether a time column is of type timestamp without a zone, and not UTC by its name."""
    import pyarrow.types as kinds

    kind = schema.field(name).type
    return bool(kinds.is_timestamp(kind) and kind.tz is None and "utc" not in name.lower())


def read_stamps(
    array: Any, name: str, options: ReadOptions, source_name: str, notes: ReadingNotes
) -> Stamps:
    """Times of an Arrow array or chunked array. Texts and plain numbers are understood as in a
    text export; rows outside the years 1678 to 2261 have none."""
    import pyarrow as pa
    import pyarrow.compute as pc
    import pyarrow.types as kinds

    if kinds.is_date(array.type):
        array = pc.cast(array, pa.timestamp("ms"))
    if not kinds.is_timestamp(array.type):
        return _from_texts(array, name, options, source_name, notes)
    unit_ns = _UNIT_NS[array.type.unit]
    ok = pc.is_valid(array).to_numpy(zero_copy_only=False)
    counts = pc.fill_null(pc.cast(array, pa.int64()), 0).to_numpy()
    limit = (2**63 - 1) // unit_ns
    ok = ok & (counts <= limit) & (counts >= -limit)
    ns = np.where(ok, counts, 0) * unit_ns
    naive = array.type.tz is None and "utc" not in name.lower()
    return Stamps(ns=ns, ok=ok, naive=naive)


def _from_texts(
    array: Any, name: str, options: ReadOptions, source_name: str, notes: ReadingNotes
) -> Stamps:
    texts = ["" if cell is None else str(cell) for cell in array.to_pylist()]
    table = RawTable(
        layout="",
        times=RawTimes(texts=texts, name=name),
        columns=(),
        numbers=range(1, len(texts) + 1),
        separator=",",
    )
    instants = read_instants(table, options, source_name, notes)
    return Stamps(ns=instants.ns, ok=instants.ok, naive=not instants.in_utc)


def instants_in_utc(
    stamps: Stamps, were_text: bool, options: ReadOptions, notes: ReadingNotes
) -> Instants:
    """Instants in UTC, or on a clock of unknown date where local times have no zone.

    ``were_text``: the times were texts or numbers, and have been through the zone already.
    """
    if not stamps.naive:
        sentence = "The times are instants in UTC."
        return Instants(ns=stamps.ns, ok=stamps.ok, in_utc=True, zone=sentence)
    if were_text:
        return undated(stamps.ns, stamps.ok, notes)
    return local_instants(stamps.ns, stamps.ok, options, notes)


def file_bounds(bounds: Bounds, naive: bool, options: ReadOptions, source_name: str) -> Bounds:
    """Bounds in UTC as the file's own times count, wide enough to lose nothing.

    Raises ``ConnectorError`` for local times without a zone: nobody knows where a window lies.
    """
    if not naive or bounds == (None, None):
        return bounds
    if options.zone is None:
        raise ConnectorError(
            f"{source_name}: a window was asked for, but the file's times have no zone; give the "
            "zone, such as 'Europe/Berlin', or read everything"
        )
    zone = ZoneInfo(options.zone)
    start, stop = bounds
    return (
        None if start is None else start + _offset_ns(start, zone) - _MARGIN_NS,
        None if stop is None else stop + _offset_ns(stop, zone) + _MARGIN_NS,
    )


def _offset_ns(ns: int, zone: ZoneInfo) -> int:
    local: datetime = instant_of(ns).astimezone(zone)
    offset = local.utcoffset()
    assert offset is not None
    return round(offset.total_seconds()) * 1_000_000_000
