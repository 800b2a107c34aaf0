"""The end of summer time in a file whose times say neither zone nor offset."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables.raw_table import Index
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.models.recording import Bools

_HOUR_NS = 3_600_000_000_000


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
