"""``Instants``: the time of every row, and what is known of its zone: the offset that rows carry,
the zone that the user gave, or none."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.raw_table import Index, RawTable
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.time_fields import NO_OFFSET, Ints
from stemwatch.connectors.historian.times.zones import after_clock_change, to_utc
from stemwatch.models.recording import Bools
from stemwatch.models.words import counted

SECOND_NS = 1_000_000_000
_ROWS_AT_ONCE = 1 << 20
_UTC_NAME = re.compile(r"(?:^|[^A-Za-z])(?:utc|gmt)(?:$|[^A-Za-z])", re.I)


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


def in_zone(
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
        for part in parts(ns.size):
            east = np.where(aware[part], offset_min[part], 0).astype(np.int64)
            ns[part] -= east * (60 * SECOND_NS)
    utc = ns
    if not naive.any():
        offsets = offset_min if ok.all() else offset_min[ok]
        return Instants(ns=utc, ok=ok, in_utc=True, zone=_offset_sentence(offsets, notes))
    if _UTC_NAME.search(table.times.name):
        notes.decide("The times are UTC by the name of their column.")
        return Instants(ns=utc, ok=ok, in_utc=True, zone="The times are written in UTC.")
    if options.zone is not None:
        notes.use("zone")
        all_naive = bool(naive.all())
        local = ns if all_naive else ns.copy()
        local, is_placed, zone = _localised(
            local, naive, options.zone, options, rows_of_tags(table), notes
        )
        ns = local if all_naive else np.where(naive, local, utc)
        return Instants(ns=ns, ok=is_placed | aware, in_utc=True, zone=zone)
    if aware.any():
        n = int(naive.sum())
        without = counted(n, "time has", "times have")
        notes.problem(f"{without} no offset while others do, and no zone was given; left out")
        return Instants(
            ns=utc, ok=aware, in_utc=True, zone=_offset_sentence(offset_min[aware], notes)
        )
    return undated(after_clock_change(ns, ok, rows_of_tags(table), notes), ok, notes)


def local_instants(ns: Ints, ok: Bools, options: ReadOptions, notes: ReadingNotes) -> Instants:
    """Instants of local times, (n,) nanoseconds, of one tag in the order of the archive.

    Without a zone in ``options`` they are on a clock of unknown date.
    """
    if options.zone is None:
        return undated(ns, ok, notes)
    notes.use("zone")
    ns, ok, sentence = _localised(ns.copy(), ok, options.zone, options, [None], notes)
    return Instants(ns=ns, ok=ok, in_utc=True, zone=sentence)


def undated(ns: Ints, ok: Bools, notes: ReadingNotes) -> Instants:
    """Local times of a zone that nobody gave: instants on a clock of unknown date."""
    zone = "The times have no zone and none was given: durations are right, the date is not known."
    notes.decide(zone)
    return Instants(ns=ns, ok=ok, in_utc=False, zone=zone)


def _localised(
    local: Ints,
    ok: Bools,
    zone: str,
    options: ReadOptions,
    groups: Sequence[Index | None],
    notes: ReadingNotes,
) -> tuple[Ints, Bools, str]:
    """UTC of local times of ``zone``, in place; which rows were placed; and the sentence."""
    ns, is_placed = to_utc(
        local,
        ok,
        zone,
        ambiguous_hour=options.ambiguous_hour,
        missing_hour=options.missing_hour,
        groups=groups,
        notes=notes,
    )
    sentence = f"Times without offset are local times of {zone}."
    notes.decide(sentence)
    return ns, is_placed, sentence


def _offset_sentence(offset_min: Ints | NDArray[np.int32], notes: ReadingNotes) -> str:
    offsets = {m for part in parts(offset_min.size) for m in np.unique(offset_min[part]).tolist()}
    distinct = [f"{m // 60:+03d}:{m % 60:02d}" if m >= 0 else f"-{-m // 60:02d}:{-m % 60:02d}"
                for m in sorted(offsets)]  # fmt: skip
    sentence = f"Each time carries its offset from UTC ({', '.join(distinct)})."
    notes.decide(sentence)
    return sentence


def rows_of_tags(table: RawTable) -> list[Index | None]:
    """The rows of each tag where each has its own times; else all rows together."""
    return [column.rows for column in table.columns] if table.narrow else [None]


def parts(size: int) -> Iterator[slice]:
    """Rows in order, so many at a time that what is made of them needs little memory."""
    for first in range(0, size, _ROWS_AT_ONCE):
        yield slice(first, first + _ROWS_AT_ONCE)
