"""The verdicts on a valve, and the four shapes of its OP-MV loop."""

from __future__ import annotations

from enum import StrEnum


class Verdict(StrEnum):
    """What the recording says about the valve."""

    HEALTHY = "healthy"
    # Does not follow from S and J: given where something other than friction is wrong with the
    # valve.
    DEFECTIVE = "defective"
    WATCH = "watch"
    STICKY = "sticky"
    UNDETERMINED = "undetermined"


# Order of the work list: a valve that could not be judged stands before a healthy one.
WORST_FIRST = (
    Verdict.STICKY,
    Verdict.DEFECTIVE,
    Verdict.WATCH,
    Verdict.UNDETERMINED,
    Verdict.HEALTHY,
)


class Shape(StrEnum):
    """The four shapes of the OP-MV loop (Choudhury 2005; Zabiri et al., section IV)."""

    DEADBAND = "deadband"  # J = 0
    UNDERSHOOT = "undershoot"  # S > J > 0
    NO_OFFSET = "no offset"  # S = J
    OVERSHOOT = "overshoot"  # S < J
