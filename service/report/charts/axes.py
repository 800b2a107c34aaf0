"""The axes of a plot: round numbers for their ends and ticks, and one scale for both where they are
in the same unit."""

from __future__ import annotations

import math

ROUND_NUMBERS = (1.0, 2.0, 2.5, 5.0, 10.0)  # times a power of ten
_ROUNDING = 1e-9  # of a step, by which a tick may miss the end of its axis


def next_round_number(least: float) -> float:
    """The smallest round number that is not below ``least``, which is above 0."""
    decade = 10.0 ** math.floor(math.log10(least))
    return next(decade * number for number in ROUND_NUMBERS if decade * number >= least)


def ticks(low: float, high: float, about: int) -> list[float]:
    """Round numbers from ``low`` to ``high``, evenly apart, ``about`` so many: one more at most."""
    step = next_round_number((high - low) / about)
    first, last = math.ceil(low / step - _ROUNDING), math.floor(high / step + _ROUNDING)
    return [step * n for n in range(first, last + 1)]


def equally_long(
    x: tuple[float, float], y: tuple[float, float], width_by_height: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Both ranges, one of them widened about its middle, so that one unit has the same length on
    either axis of a plot ``width_by_height`` times as wide as high."""
    wider = max(x[1] - x[0], width_by_height * (y[1] - y[0]))
    middle_x, middle_y = (x[0] + x[1]) / 2.0, (y[0] + y[1]) / 2.0
    half_x, half_y = wider / 2.0, wider / width_by_height / 2.0
    return (middle_x - half_x, middle_x + half_x), (middle_y - half_y, middle_y + half_y)
