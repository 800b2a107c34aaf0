"""The six coordinates that every hypothesis has; those of its terms come after them.

S in percent of travel, J/S, the reading's zero (percent) and gain (a share beyond 1), the delay of
the command within a sample (s), and the speed below which a moving stem sticks again (%/s; 0 for
the usual one).
"""

from __future__ import annotations

from stemwatch.models.recording import Floats

S_PERCENT, RATIO, ZERO, GAIN, DELAY, RESTICK = range(6)
N_BASE = 6


def S_and_J(candidate: Floats) -> tuple[float, float]:
    """S and J of a candidate (size,), percent of travel."""
    S = float(candidate[S_PERCENT])
    return S, S * float(candidate[RATIO])
