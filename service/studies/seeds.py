"""Seeds whose valves were looked at: what is counted on them is not blind."""

from __future__ import annotations

DEVELOPED_WITH = (5151, 6161, 7171, 8181, 8383, 9393)  # while the method was made
# The limits of ``explain``, on valves with nothing hidden.
LIMITS_CALIBRATED_WITH = range(4000, 4100)
INTERVALS_CALIBRATED_WITH = 11  # the intervals of S and J
