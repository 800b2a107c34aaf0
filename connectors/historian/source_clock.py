"""The source's clock: its properties, and the even grid on which the samples are placed.

A sample goes to the grid's nearest instant and keeps its value. Instants without a sample are
MISSING. Of a tag that is reported when it has moved by a deviation the last value is good until the
next, unless the archive stored nothing at all; of one of which the corners of a swinging door are
stored, the line from each to the next. Nothing else is interpolated.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.historian.columns import Column
from stemwatch.connectors.historian.times.deviation_reports import (
    by_deviation,
    heartbeat_ns,
    silent,
)
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.connectors.historian.times.timeline import Timeline, distinct_times, middle
from stemwatch.models.recording import Bools, ClockFacts, Floats, Quality

MAX_SAMPLES = 50_000_000
_GAP = 1.5  # intervals
_HOLD = 4.0  # of the tag's own intervals
_CHANCE = 0.05  # below which rows that equal those before them are copies


@dataclass(frozen=True)
class Grid:
    """``size`` instants ``origin_ns + (first + k) * interval_ns``."""

    origin_ns: int
    interval_ns: float
    first: int
    size: int

    @property
    def start_ns(self) -> int:
        return self.origin_ns + round(self.first * self.interval_ns)

    @property
    def interval_s(self) -> float:
        return self.interval_ns / 1e9

    @property
    def instants(self) -> Ints:
        steps = np.arange(self.first, self.first + self.size, dtype=np.float64)
        return self.origin_ns + np.round(steps * self.interval_ns).astype(np.int64)


def clock_facts(file_ns: Ints, zone: str) -> ClockFacts:
    """What the times of one series, in file order, were like."""
    ordered = distinct_times(file_ns)
    forward = np.diff(ordered).astype(np.float64)
    if not forward.size:
        return ClockFacts(zone=zone, repeated_times=int(file_ns.size - ordered.size))
    interval = middle(forward)
    gaps = forward[forward > _GAP * interval]
    return ClockFacts(
        jitter_s=middle(np.abs(forward - interval)) / 1e9,
        gaps=int(gaps.size),
        longest_gap_s=float(gaps.max()) / 1e9 if gaps.size else 0.0,
        repeated_times=int(file_ns.size - ordered.size),
        backward_steps=int(np.count_nonzero(file_ns[1:] < file_ns[:-1])),
        zone=zone,
    )


def interval_ns(times: Timeline) -> float:
    """The clock's interval from the times of OP.

    The mean of the even steps where four digits say it, so that rounded times (4.9999, 5.0001 ms)
    give the interval they stand for; else the median step, or the mean where a grid of the median
    would drift half an interval away from the samples (33, 33, 34 ms). Of a tag reported by
    exception its 10th percentile step, rounded to 1, 2 or 5.
    """
    steps = times.steps
    if times.by_exception:
        return _round_125(float(np.percentile(steps, 10)))
    median = middle(steps)
    even = steps[steps <= _GAP * median]
    mean = float(even.mean())
    simple = float(f"{mean:.4g}")
    if abs(simple - mean) * even.size < 0.05 * median:
        return simple
    drifts = abs(mean - median) * even.size > 0.5 * median
    return mean if drifts and abs(mean - median) < 0.05 * median else median


def _round_125(value: float) -> float:
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * min((1.0, 2.0, 5.0, 10.0), key=lambda step: abs(step - value / power)))


def make_grid(
    times: Timeline,
    tag: str,
    source: str,
    window_ns: tuple[int | None, int | None],
    *,
    step_ns: float | None = None,
) -> Grid:
    """The even grid of ``times``, cut to the window; ``step_ns`` where the interval is not theirs.
    Raises ``ConnectorError`` where there is none."""
    distinct = times.distinct
    if distinct.size < 2:
        raise ConnectorError(
            f"{source}: {tag}: {distinct.size} samples; at least two at different times are "
            "needed to tell the interval"
        )
    step = interval_ns(times) if step_ns is None else step_ns
    origin, end = int(distinct[0]), int(distinct[-1])
    last = int(np.floor((end - origin) / step + 0.5))
    start_ns, stop_ns = window_ns
    first = 0 if start_ns is None else max(0, int(np.ceil((start_ns - origin) / step)))
    stop = last + 1 if stop_ns is None else min(last + 1, int(np.ceil((stop_ns - origin) / step)))
    if stop - first > MAX_SAMPLES:
        raise ConnectorError(
            f"{source}: {tag}: {stop - first} samples of {step / 1e9:g} s would be needed for the "
            f"time from first to last sample, more than {MAX_SAMPLES}; read it in windows or split "
            "the file"
        )
    return Grid(origin, step, first, max(0, stop - first))


@dataclass(frozen=True)
class ColumnOnGrid:
    """A column on the grid: (n,) values and quality."""

    values: Floats
    quality: NDArray[np.uint8]
    decision: str = ""


def times_stored(columns: Iterable[Column]) -> Ints:
    """The times, each once, at which the archive stored anything of a valve with these
    ``columns``."""
    timelines = {id(column.times): column.times for column in columns if column.ns.size}
    distinct = [times.distinct for times in timelines.values()]
    if len(distinct) == 1:
        return distinct[0]
    return np.unique(np.concatenate(distinct)) if distinct else np.empty(0, dtype=np.int64)


def lay_column(
    column: Column, grid: Grid, *, is_clock: bool, stored: Ints | None = None
) -> ColumnOnGrid:
    """``column`` on ``grid``: at the nearest instants where it has the grid's rate, else held.

    ``stored`` are the ``times_stored`` of its valve, by which a tag at rest is told from an
    archive that was down; by default its own.
    """
    if column.ns.size == 0:
        return ColumnOnGrid(
            np.full(grid.size, np.nan), np.full(grid.size, Quality.MISSING, np.uint8)
        )
    if by_deviation(column.times, column.values):
        return _lay_reports(column, grid, column.times.distinct if stored is None else stored)
    exception, usual_step = column.times.by_exception, column.times.usual_step
    own_step_ns = grid.interval_ns if usual_step is None else usual_step
    if not exception and (is_clock or own_step_ns <= 1.1 * grid.interval_ns):
        return _lay_nearest(column, grid)
    return _lay_held(column, grid, own_step_ns, exception)


def lay_lines(column: Column, grid: Grid, stored: Ints) -> ColumnOnGrid:
    """The lines between the corners of a swinging door, within whose deviation ``column`` lay. A
    bad corner leaves out the lines on both sides. MISSING before the first and after the last, and
    where the archive stored nothing of the valve (``stored``) for long."""
    instants = grid.instants
    assert column.times.usual_step is not None  # of a tag whose steps are uneven
    limit = _hold_limit(column.times, column.times.usual_step, exception=True)
    limit = max(limit, heartbeat_ns(column.times))
    last_of_time = np.append(column.ns[1:] > column.ns[:-1], True)
    ns, values = column.ns[last_of_time], column.values[last_of_time]
    quality = column.quality[last_of_time]
    after = np.clip(np.searchsorted(ns, instants, side="left"), 0, ns.size - 1)
    before = np.where(ns[after] == instants, after, np.maximum(after - 1, 0))
    within = (ns[before] <= instants) & (instants <= ns[after])
    wait = np.maximum(ns[after] - ns[before], 1)
    share = (instants - ns[before]) / wait
    on_line = values[before] + share * (values[after] - values[before])
    known = within & ~silent(stored, instants, limit)
    worse = np.maximum(quality[before], quality[after])
    on_grid = np.where(known, worse, Quality.MISSING).astype(np.uint8)
    decision = (
        f"{column.tag} holds the corners of a swinging door: lines are drawn from each to the "
        f"next, except where nothing of this valve was stored for {limit / 1e9:g} s."
    )
    return ColumnOnGrid(np.where(on_grid <= Quality.HELD, on_line, np.nan), on_grid, decision)


@dataclass(frozen=True)
class SamplesOnGrid:
    """Where the samples of a timeline fall on a grid.

    ``inside`` (n,) are the samples that do, ``instants`` (m,) their instants from the grid's first;
    ``one_to_one`` whether they are all samples and all instants in turn. ``moved`` (n,) are those
    that repeat a time and were laid on the empty instant after it.
    """

    inside: Bools
    instants: Ints
    one_to_one: bool
    moved: Bools


@lru_cache(maxsize=1)  # the tags of a valve are laid one after the other, and share their times
def samples_on_grid(times: Timeline, grid: Grid) -> SamplesOnGrid:
    """The nearest instant of each sample, repeated times put right."""
    index, moved = _repeated_to_hole(times.ns, nearest_index(times.ns, grid))
    in_grid = (index >= grid.first) & (index < grid.first + grid.size)
    instants = index[in_grid] - grid.first
    one_to_one = index.size == grid.size and np.array_equal(instants, np.arange(grid.size))
    return SamplesOnGrid(in_grid, instants, one_to_one, moved)


def _lay_nearest(column: Column, grid: Grid) -> ColumnOnGrid:
    places = samples_on_grid(column.times, grid)
    copied = _only_copies(column, places.moved)
    moved = 0 if copied else int(np.count_nonzero(places.moved))
    decision = (
        f"{moved} rows repeat the time before them and leave the next instant empty; their "
        "time was stamped early, so they were laid on that instant."
        if moved
        else ""
    )
    if places.one_to_one and not copied:
        return ColumnOnGrid(column.values, column.quality, decision)
    inside, instants = places.inside, places.instants
    if copied:
        inside, instants = inside & ~places.moved, instants[~places.moved[inside]]
    values = np.full(grid.size, np.nan)
    quality = np.full(grid.size, Quality.MISSING, dtype=np.uint8)
    # Of several samples at one instant numpy keeps the last written, which is the last in time.
    values[instants] = column.values[inside]
    quality[instants] = column.quality[inside]
    return ColumnOnGrid(values, quality, decision)


def _only_copies(column: Column, moved: Bools) -> bool:
    """Whether the ``moved`` samples are rows that the archive holds twice, and the instants after
    them are empty for another reason: all equal the one before, which is no chance with a signal
    that seldom repeats itself from row to row."""
    at = np.flatnonzero(moved)
    if not at.size:
        return False
    values, quality = column.values, column.quality
    same = (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    same &= quality[1:] == quality[:-1]
    others = np.delete(same, at - 1)
    return bool(np.all(same[at - 1]) and np.mean(others) ** at.size < _CHANCE)


def nearest_index(ns: Ints, grid: Grid) -> Ints:
    """Nearest instant of each sample, counted within its own gap-free stretch.

    After a gap a source often goes on off the old grid; by counting from the stretch's first
    sample, samples half an interval off do not fall on one instant two by two.
    """
    steps = np.diff(ns)
    begins = np.concatenate(([True], steps > _GAP * grid.interval_ns))
    stretch = np.cumsum(begins) - 1
    first_ns = ns[begins][stretch]
    base = np.floor((first_ns - grid.origin_ns) / grid.interval_ns + 0.5)
    within = np.floor((ns - first_ns) / grid.interval_ns + 0.5)
    return np.asarray((base + within).astype(np.int64))


def _repeated_to_hole(ns: Ints, index: Ints) -> tuple[Ints, Bools]:
    """The second of two rows with one time moves to the next instant where that is empty; which
    rows do."""
    twin = np.zeros(index.size, dtype=bool)
    if index.size < 3:
        return index, twin
    twin[1:-1] = (ns[1:-1] == ns[:-2]) & (index[2:] == index[1:-1] + 2)
    return np.where(twin, index + 1, index), twin


def _lay_held(column: Column, grid: Grid, own_step_ns: float, exception: bool) -> ColumnOnGrid:
    instants = grid.instants
    last = np.searchsorted(column.ns, instants, side="right") - 1
    age = instants - column.ns[np.maximum(last, 0)]
    limit = _hold_limit(column.times, own_step_ns, exception)
    has_sample = (last >= 0) & (age <= limit)
    sample_index = np.maximum(last, 0)
    old = has_sample & (age > _GAP * max(grid.interval_ns, own_step_ns))
    quality = np.where(has_sample, column.quality[sample_index], Quality.MISSING)
    quality = np.where(old & (quality == Quality.GOOD), Quality.HELD, quality)
    values = np.where(quality <= Quality.HELD, column.values[sample_index], np.nan)
    kind = (
        "is reported when it changes" if exception else f"has a sample each {own_step_ns / 1e9:g} s"
    )
    decision = (
        f"{column.tag} {kind}; its last value is held for at most {limit / 1e9:g} s and marked as "
        f"held when older than {_GAP * max(grid.interval_ns, own_step_ns) / 1e9:g} s."
    )
    return ColumnOnGrid(values, quality.astype(np.uint8), decision)


def _lay_reports(column: Column, grid: Grid, stored: Ints) -> ColumnOnGrid:
    """Each report until the next. After the last one it is held as any tag is."""
    assert column.times.usual_step is not None  # of a tag whose steps are uneven
    instants = grid.instants
    limit = _hold_limit(column.times, column.times.usual_step, exception=True)
    limit = max(limit, heartbeat_ns(column.times))
    last = np.searchsorted(column.ns, instants, side="right") - 1
    sample = np.maximum(last, 0)
    ended = (last == column.ns.size - 1) & (instants - column.ns[sample] > limit)
    known = (last >= 0) & ~ended & ~silent(stored, instants, limit)
    quality = np.where(known, column.quality[sample], Quality.MISSING).astype(np.uint8)
    decision = (
        f"{column.tag} is reported when it has moved by a deviation: between two reports it is "
        "taken to rest at the earlier one, except where nothing of this valve was stored for "
        f"{limit / 1e9:g} s."
    )
    return ColumnOnGrid(
        np.where(quality <= Quality.HELD, column.values[sample], np.nan), quality, decision
    )


def _hold_limit(times: Timeline, own_step_ns: float, exception: bool) -> float:
    """A few of the tag's own intervals; by exception as long as it usually stays silent."""
    if not exception:
        return _HOLD * own_step_ns
    return max(_HOLD * own_step_ns, float(np.percentile(times.steps, 99)))
