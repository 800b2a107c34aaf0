"""Reports by a deviation: a tag that is stored when its value has moved by so much, and not before.

Such a tag is known between two reports: it lies within the deviation of the last one, however long
that was ago. A stem that sticks is reported seldom, and just then it is told to rest.

What tells such an archive is that no two reports in a row lie nearer than the deviation d, and many
little farther. Of an archive that draws lines between stored points (swinging door), or one with
uneven scans, the changes c from one report to the next are as often near zero as elsewhere:

    share = P(c < 2 m),  m the 2nd percentile of c

is about 4 % there (twice what lies below m), and a quarter and more where values are reported from
a deviation on. Reports that come only because none came for the longest time (a heartbeat) are left
out.
"""

from __future__ import annotations

import numpy as np

from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.models.recording import Bools, Floats

SMALLEST = 2.0  # percentile of the changes, of which a few may be rounded or out of order
# `python tests/benchmarks/bench_deviation_reports.py` derives this from archives of both kinds.
SHARE, SHARE_OF_FEW = 0.15, 0.5
FEWEST, FEW = 30, 300  # changes
HEARTBEAT = 0.9  # of the longest time between two reports
AS_LONG, FEWEST_BEATS = 0.98, 3  # of the longest time, and so often
UNEVEN = 0.1  # share of times from one sample to the next that are longer than usual
LONGER = 1.5  # usual steps
_EQUAL = 1e-6  # of m: two changes by the same number of steps of a transmitter


def share_near_smallest(times: Timeline, values: Floats) -> tuple[float, int] | None:
    """The share of the changes (n - 1,) of ``values`` (n,) at ``times`` (n,) that are less than
    twice the smallest, and how many changes there are; ``None`` of too few, or where values repeat
    themselves."""
    if not times.steps.size or times.ns.size != values.size:
        return None
    waits = np.diff(times.ns)
    changes = np.abs(np.diff(values))[waits < HEARTBEAT * times.steps.max()]
    changes = changes[np.isfinite(changes)]
    if changes.size < FEWEST:
        return None
    smallest = float(np.percentile(changes, SMALLEST))
    if smallest <= 0.0:
        return None
    return float(np.mean(changes < (2.0 - _EQUAL) * smallest)), changes.size


def by_deviation(times: Timeline, values: Floats) -> bool:
    """Whether ``values`` (n,) at ``times`` (n,) were stored when they had moved by a deviation."""
    steps, usual_step = times.steps, times.usual_step
    if usual_step is None or not np.mean(steps > LONGER * usual_step) >= UNEVEN:
        return False
    near = share_near_smallest(times, values)
    if near is None:
        return False
    share, count = near
    # Of few changes the smallest may be large by chance; and a tag that is seldom reported moves
    # slowly, so that most reports come just beyond the deviation.
    return share >= (SHARE if count >= FEW else SHARE_OF_FEW)


def heartbeat_ns(times: Timeline) -> float:
    """The longest time that the archive lets pass without a report; 0 where none is seen."""
    steps = times.steps
    if not steps.size:
        return 0.0
    longest = float(steps.max())
    beats = np.count_nonzero(steps >= AS_LONG * longest)
    return longest if beats >= FEWEST_BEATS else 0.0


def silent(stored: Ints, instants: Ints, longest_ns: float) -> Bools:
    """(n,) of which ``instants`` the archive has ``stored`` (m,) nothing at all, of any tag of the
    valve, for more than ``longest_ns`` around."""
    after = np.searchsorted(stored, instants, side="right")
    before = stored[np.maximum(after - 1, 0)]
    next_one = stored[np.minimum(after, stored.size - 1)]
    return np.asarray(next_one - before > longest_ns)
