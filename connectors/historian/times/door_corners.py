"""Corners of a swinging door: a tag of which the archive keeps only the points at which it bends.

From each point kept, the archive follows the samples as long as one straight line passes within a
deviation d of all of them. So between two points kept the tag lies within d of the line that joins
them, however far apart they are.

Nothing in an export says so. What tells corners is

- times on the lattice of a scan that is much finer than the usual time from point to point, at
  other times for each tag: the archive saw far more samples than it kept;
- the bend at a point whose neighbours are one scan away on either side,

      b_k = |y_k - (y_(k-1) + y_(k+1))/2|,

  which exceeds d, for the point would have been dropped. Samples taken at some scans, and reports
  of a value that has moved, bend little as often as much;
- jumps: a tag that rests and then steps has a corner on either side of the step, one scan apart. A
  tag that is stored when somebody changes it has the later one alone, and is no ramp from change to
  change.

A smooth tag has neither such bends nor jumps. It is taken for corners where every tag of its valve
comes on such a lattice and none of them contradicts; not if a hand may have set it to round values.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from stemwatch.connectors.historian.columns import Column
from stemwatch.connectors.historian.times.deviation_reports import by_deviation
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.models.recording import Bools, Floats, Quality, Role
from stemwatch.models.signals.forensics import quantum

# `python tests/benchmarks/bench_door_corners.py` counts what these tell.
UNEVEN, UNLIKE = 0.2, 0.2  # share of waits that differ from the usual one, by this share of it
FINER = 3.0  # scans from point to point, usually, at least
SCANS_S = (10.0, 5.0, 2.0, 1.0, 0.5, 0.25, 0.2, 0.1)  # of controllers and gateways
WHOLE, OFF = 0.95, 0.05  # share of the waits that are whole scans, to this share of a scan
FEWEST = 20  # points
FEWEST_BENDS, FEWEST_FOR_DEVIATION = 40, 10
SMALLEST, OF_USUAL = 5.0, 0.3  # percentile of these bends, as a share of their median at least
OF_CLOSE, OF_TURNING = 1.1, 1.8  # deviations
FEWEST_JUMPS, MOSTLY = 5, 0.5
AT_REST = 0.3  # of a jump: what the tag moved until the point before it, at most
SAMPLES_OF_A_LINE = 10.0
ROUND = 0.002  # of its range: the step of a tag that is set by hand, at least
BY_HAND = (Role.OP, Role.SP, Role.MODE)


def find_corners(columns: Mapping[Role, Column]) -> frozenset[Role]:
    """The roles of a valve whose ``columns`` hold the corners of a swinging door; none where OP
    does not: a position by lines beside a command in steps would look as if it stuck.
    """
    known = {role: column for role, column in columns.items() if _distinct(column) >= FEWEST}
    scans = {role: scan_ns(column.times) for role, column in known.items()}
    uneven = [role for role, scan in scans.items() if scan is not None]
    if Role.OP not in uneven:
        return frozenset()
    tells = {role: _bends_or_jumps(known[role]) for role in uneven}
    reported = [role for role in uneven if by_deviation(known[role].times, known[role].values)]
    shown = {role for role in uneven if tells[role] and role not in reported}
    sparse = all(_much_finer(column.times, scans[role]) for role, column in known.items())
    if not shown and (reported or not sparse or False in tells.values() or _in_rows(known)):
        return frozenset()
    changed_by_hand = {role for role in uneven if role in BY_HAND and _round(known[role].values)}
    corners = shown | ({role for role in uneven if tells[role] is not False} - changed_by_hand)
    return frozenset(corners if Role.OP in corners else ())


def _in_rows(known: Mapping[Role, Column]) -> bool:
    """Whether another tag has the times of OP: samples of a table, where corners have their own."""
    op = known[Role.OP]
    return any(column.times is op.times for role, column in known.items() if role is not Role.OP)


def _much_finer(times: Timeline, scan: float | None) -> bool:
    return scan is not None and (times.usual_step or 0.0) >= FINER * scan


@lru_cache(maxsize=8)
def scan_ns(times: Timeline) -> float | None:
    """The scan on whose lattice uneven ``times`` lie, ns; ``None`` where they are even, or on
    none."""
    steps, usual_step = times.steps, times.usual_step
    if usual_step is None or steps.size + 1 < FEWEST:
        return None
    if not np.mean(np.abs(steps - usual_step) > UNLIKE * usual_step) >= UNEVEN:
        return None
    for scan_s in SCANS_S:
        scan = 1e9 * scan_s
        off = np.abs(steps / scan - np.round(steps / scan))
        if np.mean(off <= OFF) >= WHOLE:
            return scan
    return None


def lines_interval_ns(times: Timeline) -> float:
    """Nanoseconds between samples of the lines through corners at ``times``: whole scans, and ten
    samples from corner to corner or up to twice as many."""
    scan = scan_ns(times)
    assert scan is not None  # of corners
    assert times.usual_step is not None
    most = max(times.usual_step / (SAMPLES_OF_A_LINE * scan), 1.0)
    decade = 10.0 ** np.floor(np.log10(most) + 1e-9)
    return float(
        scan * decade * max(step for step in (1, 2, 5) if step * decade <= most * (1 + 1e-9))
    )


def door_deviation(column: Column) -> float:
    """The deviation d of the door that kept the corners of ``column``, in its unit, about.

    A corner with both neighbours one scan away bends by d at least, by 1.5 d where the archive lets
    the line end within d of the next sample, and the 5th percentile of ten such bends by little
    more. Else by the median of the bends that turn the other way than both beside them, which is
    about 2 d in the middle of the tags, and 0.6 to 6 d in eight of ten.
    """
    ns, values = _points(column)
    bends, close = _bends(ns, values, scan_ns(column.times) or 0.0)
    if np.count_nonzero(close) >= FEWEST_FOR_DEVIATION:
        return float(np.percentile(np.abs(bends[close]), SMALLEST)) / OF_CLOSE
    to_and_fro = np.zeros(bends.size, dtype=bool)
    turns = bends[1:] * bends[:-1] < 0.0
    to_and_fro[1:-1] = turns[1:] & turns[:-1]
    chosen = to_and_fro if np.count_nonzero(to_and_fro) >= FEWEST_FOR_DEVIATION else bends != 0.0
    return float(np.median(np.abs(bends[chosen]))) / OF_TURNING


def _distinct(column: Column) -> int:
    return int(np.unique(column.values[column.quality <= Quality.HELD]).size)


def _points(column: Column) -> tuple[Floats, Floats]:
    """Times, ns, and values of the good points; of several at one time the last."""
    good = column.quality <= Quality.HELD
    ns, values = column.ns[good], column.values[good]
    last = np.append(ns[1:] > ns[:-1], True)[: ns.size]
    return ns[last].astype(np.float64), values[last]


def _bends(ns: Floats, values: Floats, scan: float) -> tuple[Floats, Bools]:
    """(n - 2,) by how much each inner point lies above the line between its neighbours, and whether
    both are one scan away."""
    waits = np.diff(ns)
    before, after = waits[:-1], waits[1:]
    line = values[:-2] + before / (before + after) * (values[2:] - values[:-2])
    close = np.maximum(before, after) <= (1.0 + OFF) * scan
    return values[1:-1] - line, close


def _bends_or_jumps(column: Column) -> bool | None:
    """Whether the points bend or jump as corners do; ``None`` where too few could."""
    scan = scan_ns(column.times)
    assert scan is not None
    ns, values = _points(column)
    bends, close = _bends(ns, values, scan)
    if np.count_nonzero(close) >= FEWEST_BENDS:
        smallest, usual = np.percentile(np.abs(bends[close]), (SMALLEST, 50.0))
        return bool(smallest >= OF_USUAL * usual > 0.0)
    moves, waits = np.abs(np.diff(values)), np.diff(ns)
    jumps = (
        (waits[1:] <= (1.0 + OFF) * scan) & (waits[:-1] > (1.0 + OFF) * scan) & (moves[1:] > 0.0)
    )
    rested = jumps & (moves[:-1] <= AT_REST * moves[1:])
    if np.count_nonzero(jumps) < FEWEST_JUMPS:
        return None
    return True if np.count_nonzero(rested) >= MOSTLY * np.count_nonzero(jumps) else None


def _round(values: Floats) -> bool:
    """Whether ``values`` are multiples of a step that is coarse for their range."""
    finite = values[np.isfinite(values)]
    return bool(quantum(finite) >= ROUND * np.ptp(finite))
