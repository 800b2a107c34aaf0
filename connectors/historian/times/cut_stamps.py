"""Time stamps that a spreadsheet cut to the minute or second: the spacing is restored."""

from __future__ import annotations

import numpy as np

from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.models.recording import Bools

_FEWEST_STAMPS = 4
_ALIKE = 0.98  # of the stamps have the same number of rows


def evenly_within_stamps(ns: Ints, ok: Bools) -> tuple[Ints, int] | None:
    """Instants (n,) of rows of which k at a time share a stamp, and k; ``None`` where it is not so.

    Stamps a step D apart with k rows each mean rows D/k apart. The first stamp may have fewer rows,
    which are its last ones; so may the last, whose rows are its first ones. A stamp with more than
    k rows, or stamps that step backward, settle nothing.
    """
    if not ok.all():
        return None
    starts = np.flatnonzero(np.diff(ns, prepend=ns[0] - 1))
    counts = np.diff(np.append(starts, ns.size))
    if starts.size < _FEWEST_STAMPS:
        return None
    each = int(np.median(counts[1:-1]))
    steps = np.diff(ns[starts])
    step = int(np.median(steps))
    inner = counts[1:-1]
    if each < 2 or counts.max() > each or (inner == each).mean() < _ALIKE or steps.min() <= 0:
        return None
    if (steps == step).mean() < _ALIKE:
        return None
    place = np.arange(ns.size) - np.repeat(starts, counts)
    place[: counts[0]] += each - counts[0]
    return ns + place * step // each, each
