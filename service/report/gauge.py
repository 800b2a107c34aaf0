"""Where S and J stand on a bar: one scale for all valves, so that bars can be compared by eye."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from stemwatch.models.estimate import Estimate
from stemwatch.models.screening_result import Screening
from stemwatch.service.report.words import finite

SMALLEST_TOP_PERCENT = 2.0
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True, kw_only=True)
class Gauge:
    """Positions on the bar in percent of its length; ``beyond`` where the value is off it."""

    at: float
    low: float
    high: float
    beyond: bool


def gauge_top(screenings: Iterable[Screening]) -> float:
    """The round number at the bars' right end, percent of OP span: it holds every value."""
    values = [
        finite(estimate.value) or 0.0
        for screening in screenings
        for estimate in (screening.S, screening.J)
    ]
    largest = max([SMALLEST_TOP_PERCENT, *values])
    decade = 10.0 ** math.floor(math.log10(largest))
    return next(decade * step for step in _STEPS if decade * step >= largest)


def gauge(estimate: Estimate, top: float) -> Gauge | None:
    """``estimate`` on a bar from 0 to ``top``; ``None`` where there is no value."""
    value = finite(estimate.value)
    if value is None:
        return None
    low, high = finite(estimate.low), finite(estimate.high)
    return Gauge(
        at=_place(value, top),
        low=_place(value if low is None else low, top),
        high=_place(value if high is None else high, top),
        beyond=high is not None and high > top,
    )


def _place(value: float, top: float) -> float:
    return round(100.0 * min(max(value / top, 0.0), 1.0), 1)
