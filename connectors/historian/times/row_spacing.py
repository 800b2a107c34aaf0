"""The interval between rows where their times do not give it: stamps that a spreadsheet truncated
to the minute or second, and columns that only count rows."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.models.recording import Bools, Floats

_FEWEST_STAMPS = 4
_ALIKE = 0.98  # of the stamps have as many rows, and of the steps between them the same length
_COUNTED = 0.9  # of the steps of a column that counts rows are 1


@dataclass(frozen=True)
class Spread:
    """(n,) instants of rows that share stamps, the rows of a stamp in words, and the interval."""

    ns: Ints
    each: str
    interval_s: float


def evenly_within_stamps(ns: Ints, ok: Bools) -> Spread | None:
    """Instants of rows of which several at a time share a stamp; ``None`` where it is not so.

    ``ns`` (n,) in the order of the rows. Stamps a step D apart with k rows each mean rows D/k
    apart. The first stamp may have fewer rows, which are its last ones; so may the last, whose rows
    are its first ones. Where D is no multiple of the interval d, stamps have now one row more and
    now one fewer: then rows lie on a line t0 + i d that no stamp contradicts. With stamps that go
    backward no spacing is derived.
    """
    starts, counts = _stamps(ns, ok)
    if starts.size < _FEWEST_STAMPS:
        return None
    steps, inner = np.diff(ns[starts]), counts[1:-1]
    step = int(np.median(steps))
    if steps.min() <= 0 or (steps == step).mean() < _ALIKE or inner.mean() < 1.9:
        return None
    rows_per_stamp = int(np.median(inner))
    if counts.max() <= rows_per_stamp and (inner == rows_per_stamp).mean() >= _ALIKE:
        index_in_stamp = np.arange(ns.size) - np.repeat(starts, counts)
        index_in_stamp[: counts[0]] += rows_per_stamp - counts[0]
        return Spread(
            ns + index_in_stamp * step // rows_per_stamp,
            f"{rows_per_stamp}",
            step / rows_per_stamp / 1e9,
        )
    mostly_alike = (np.abs(inner - inner.mean()) <= 1.05).mean() >= _ALIKE
    return _on_a_line(ns, starts, counts, step) if mostly_alike else None


def at_interval(ns: Ints, ok: Bools, interval_s: float) -> Ints | None:
    """Instants of rows ``interval_s`` apart that share stamps, each no earlier than its stamp and
    before the next; ``None`` where rows do not share stamps or the stamps contradict."""
    starts, counts = _stamps(ns, ok)
    if starts.size < 2 or np.median(counts) < 2:
        return None
    steps = np.diff(ns[starts])
    if steps.min() <= 0:
        return None
    return _spread_on_line(ns, starts, int(np.median(steps)), interval_s * 1e9)


def counts_rows(numbers: Floats) -> bool:
    """Whether whole numbers that rise by 1 from row to row stand in a column."""
    if numbers.size < 3 or not bool((numbers == np.round(numbers)).all()):
        return False
    steps = np.diff(numbers)
    return bool((steps == 1.0).mean() >= _COUNTED and steps.min() > 0.0)


def _stamps(ns: Ints, ok: Bools) -> tuple[Ints, Ints]:
    """The first row of each stamp, and its number of rows; none where a row has no time."""
    none = np.zeros(0, dtype=np.int64)
    if not ns.size or not ok.all():
        return none, none
    starts = np.flatnonzero(np.diff(ns, prepend=ns[0] - 1))
    return starts, np.diff(np.append(starts, ns.size))


def _on_a_line(ns: Ints, starts: Ints, counts: Ints, step: int) -> Spread | None:
    first, end = max(_without_gaps(ns, starts, step), key=lambda part: part[1] - part[0])
    if end - first < _FEWEST_STAMPS:
        return None
    rows = int(counts[first + 1 : end - 1].sum())
    mean = step * (end - first - 2) / rows
    simple = (float(f"{mean:.{digits}g}") for digits in range(1, 6))
    stretch = ns[starts[first] : starts[end - 1] + counts[end - 1]]
    for interval in simple:
        low, high = _room(stretch, step, interval)
        if low <= high:
            break
    else:
        interval = mean
    spread_ns = _spread_on_line(ns, starts, step, interval)
    fewest, largest = (int(n) for n in np.percentile(counts[1:-1], (1.0, 99.0)))
    return (
        None if spread_ns is None else Spread(spread_ns, f"{fewest} to {largest}", interval / 1e9)
    )


def _without_gaps(ns: Ints, starts: Ints, step: int) -> list[tuple[int, int]]:
    """First stamp and the one after the last of each part whose stamps are a step apart."""
    breaks = np.flatnonzero(np.diff(ns[starts]) != step) + 1
    return list(pairwise([0, *breaks.tolist(), int(starts.size)]))


def _spread_on_line(ns: Ints, starts: Ints, step: int, interval: float) -> Ints | None:
    """Rows on a line in each part without a gap, ``None`` where one misses its stamps by more than
    an interval, which is what a clock may wander."""
    out = ns.copy()
    for first, end in _without_gaps(ns, starts, step):
        stop = int(starts[end]) if end < starts.size else ns.size
        rows = slice(int(starts[first]), stop)
        low, high = _room(ns[rows], step, interval)
        if low > high + interval:
            return None
        begin = low if low <= high else (low + high) / 2.0
        out[rows] = np.round(begin + np.arange(stop - rows.start) * interval).astype(np.int64)
    return out


def _room(ns: Ints, step: int, interval: float) -> tuple[float, float]:
    """Earliest and latest time of the first row of a line on which each row is within its stamp."""
    line = ns - ns[0] - np.arange(ns.size) * interval
    return float(ns[0] + line.max()), float(ns[0] + line.min() + step - 1)
