"""A position that stands beside OP by a few percent although its stem follows: a reading, or a
positioner's range, that is off.

A zero or a span that is off by 2 % and more is a finding of its own (``mismatch.terms``). Where
the search for effects does not confirm it, or a curve from OP to stroke was fitted that takes it
in, the valve would be healthy without a word about it. With a curve f, a gain g and a zero z of the
fit

    off at OP = z + (1 + g) f(OP) - OP

at the ends of the OP that was used. A curve of another slope, or a bent one, is meant so by those
who set the positioner, and says nothing of its reading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.mismatch.terms._common import CALIBRATE_FROM_PERCENT
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.stroke_curve import NEARLY_LINEAR_PERCENT, StrokeCurve

# Of a curve that is meant to be OP percent for percent of travel. Split ranges and part strokes are
# set to a half, a third or two thirds.
SLOPES = (0.8, 1.25)
ENDS = (5.0, 95.0)  # percentiles of OP
CHECK_READING = (
    "Set OP to two places by hand, read the valve's own scale, and correct zero and span of the "
    "position transmitter, or the range of the positioner. If it is meant so, give the curve in "
    "the plant file (stroke_curve)."
)


@dataclass(frozen=True)
class ReadingOff:
    """How far the position reads above OP, percent, at the ``low`` and at the ``high`` end of the
    OP that was used, percent."""

    low: float
    at_low: float
    high: float
    at_high: float

    @property
    def percent(self) -> float:
        """The larger of the two."""
        return max(abs(self.at_low), abs(self.at_high))

    def sentence(self) -> str:
        """What is off, and where."""
        return (
            f"The position stands {_beside(self.at_low)} OP at {self.low:.0f} %, and "
            f"{_beside(self.at_high)} it at {self.high:.0f} %: its reading or the range of the "
            "positioner is off, unless it is meant so."
        )


def reading_off(op: Floats, curve: StrokeCurve | None, candidate: Floats) -> ReadingOff | None:
    """How far the position reads beside ``op`` (n,), percent, finite, by the fitted ``candidate``
    (9,); ``None`` below 2 %, and where a curve is given or meant."""
    if not op.size:
        return None
    if curve is not None and not _meant_as_none(curve):
        return None
    low, high = np.percentile(op, ENDS)
    ends = np.array((low, high))
    gain, zero = 1.0 + candidate[coordinate.GAIN], candidate[coordinate.ZERO]
    reads = zero + gain * (ends if curve is None else curve.command(ends))
    at_low, at_high = (reads - ends).tolist()
    off = ReadingOff(float(low), at_low, float(high), at_high)
    return off if off.percent >= CALIBRATE_FROM_PERCENT else None


def _meant_as_none(curve: StrokeCurve) -> bool:
    """Whether a curve is as good as OP percent for percent of travel, but for a zero and a span."""
    straight = curve.bend_percent <= NEARLY_LINEAR_PERCENT and curve.slope_known
    return straight and not curve.given and SLOPES[0] <= curve.slope <= SLOPES[1]


def _beside(percent: float) -> str:
    return f"{abs(percent):.1f} % {'above' if percent >= 0.0 else 'below'}"
