"""How a process archive thins a column: swinging door and exception reporting."""

from __future__ import annotations

import numpy as np
from numba import njit

from stemwatch.models.recording import Bools, Floats


@njit(cache=True)
def swinging_door(values: Floats, deviation: float) -> Bools:
    """(n,) True at the samples a swinging door keeps.

    From the last kept sample two doors open to ``deviation`` above and below each new sample; when
    they no longer leave a straight way through, the sample before is kept and the doors start
    anew there. Every dropped sample then lies within ``deviation`` of the line between the kept
    ones. The first and the last sample are always kept.
    """
    kept = np.zeros(values.size, dtype=np.bool_)
    kept[0] = True
    kept[values.size - 1] = True
    anchor = 0
    highest, lowest = -np.inf, np.inf
    for i in range(1, values.size):
        span = i - anchor
        rise = values[i] - values[anchor]
        slope = rise / span
        if slope > lowest or slope < highest:
            anchor = i - 1
            kept[anchor] = True
            rise = values[i] - values[anchor]
            highest, lowest = rise - deviation, rise + deviation
            continue
        highest = max(highest, (rise - deviation) / span)
        lowest = min(lowest, (rise + deviation) / span)
    return kept


@njit(cache=True)
def exception_report(values: Floats, deviation: float) -> Floats:
    """(n,) the last reported value; a sample is reported when it is more than ``deviation`` away
    from it."""
    held = np.empty_like(values)
    last = values[0]
    for i in range(values.size):
        if abs(values[i] - last) > deviation:
            last = values[i]
        held[i] = last
    return held
