"""What a recording asked for beside friction: dead time, lag, a top speed, in one plain line."""

from __future__ import annotations

from stemwatch.models.screening_result import Screening
from stemwatch.service.presenter.wording import finite, span_percent

# Below a tenth of the sampling interval a time is not seen in samples but guessed between them,
# and below a tenth of a second nobody at a control valve asks.
LEAST_SHARE_OF_INTERVAL = 0.1
SMALLEST_TIME_S = 0.1
# A stem that crosses its travel in five seconds is no slow one.
FASTEST_PERCENT_PER_S = 20.0
ALIKE_SHARE = 0.2  # two directions closer than this are said once
NAIVE_SHARE = 1 / 3
SMALLEST_NAIVE_STEP_PERCENT = 0.2
_NAIVE_SAID = "S and J alone"


def beside_friction(screening: Screening) -> str:
    """One sentence on what delays or slows the stem; empty where nothing but friction was seen."""
    said = [one for one in (_late(screening), _lag(screening), _speed(screening)) if one]
    return f"Beside friction: {'; '.join(said)}." if said else ""


def without_them(screening: Screening) -> str:
    """What S and J alone would have read for S, where that differs by more than a third of S."""
    S, naive = finite(screening.S.value), _value(screening, "naive_S_percent")
    if S is None or naive is None or _NAIVE_SAID in screening.reason:
        return ""
    if abs(naive - S) <= max(NAIVE_SHARE * S, SMALLEST_NAIVE_STEP_PERCENT):
        return ""
    return f"{_NAIVE_SAID} would have read S {span_percent(naive)} %."


def _value(screening: Screening, name: str) -> float | None:
    indicator = screening.indicators.get(name)
    return None if indicator is None else finite(indicator.value)


def _time(screening: Screening, name: str) -> float | None:
    """The time where the recording is fine enough to have shown it."""
    seen = screening.seen
    interval_s = 0.0 if seen is None else seen.interval_s
    value = _value(screening, name)
    if value is None or value < max(LEAST_SHARE_OF_INTERVAL * interval_s, SMALLEST_TIME_S):
        return None
    return value


def _late(screening: Screening) -> str:
    dead = _time(screening, "dead_time_s")
    return "" if dead is None else f"command arrives {dead:.1f} s late"


def _lag(screening: Screening) -> str:
    times = _time(screening, "lag_rising_s"), _time(screening, "lag_falling_s")
    return _two_ways(*times, "s", "follows with a lag of")


def _speed(screening: Screening) -> str:
    names = ("speed_rising_percent_per_s", "speed_falling_percent_per_s")
    found = [_value(screening, name) for name in names]
    slow = [one if one is not None and one <= FASTEST_PERCENT_PER_S else None for one in found]
    return _two_ways(slow[0], slow[1], "%/s", "moves at most")


def _two_ways(rising: float | None, falling: float | None, unit: str, what: str) -> str:
    if rising is None and falling is None:
        return ""
    if rising is None:
        return f"{what} {falling:.1f} {unit} when position falls"
    if falling is None:
        return f"{what} {rising:.1f} {unit} when position rises"
    if abs(rising - falling) <= ALIKE_SHARE * max(rising, falling):
        return f"{what} {(rising + falling) / 2:.1f} {unit}"
    return f"{what} {rising:.1f} {unit} rising and {falling:.1f} {unit} falling"
