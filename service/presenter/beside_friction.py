"""What delays or slows the stem beside friction, by the quick fit, in one or two sentences."""

from __future__ import annotations

from collections.abc import Callable

from stemwatch.models.preparation.own_clock import duration, rate
from stemwatch.models.screening_result import Screening
from stemwatch.service.presenter.wording import finite, span_percent

# Below a tenth of the sampling interval a time is not measured but interpolated.
LEAST_SHARE_OF_INTERVAL = 0.1
# A stem that crosses its travel in five seconds is not slow; on a faster record, in five samples.
FASTEST_PERCENT = 20.0
ALIKE_SHARE = 0.2  # times of both directions that differ by less are given as one
# From which difference on the S of a fit of S and J alone is said beside S.
NAIVE_SHARE = 1 / 3  # of S
SMALLEST_NAIVE_STEP_PERCENT = 0.2
_NAIVE_SAID = "S and J alone"


def beside_friction(screening: Screening) -> str:
    """One sentence on what delays or slows the stem; empty where nothing but friction was seen."""
    clauses = [
        clause for clause in (_late(screening), _lag(screening), _speed(screening)) if clause
    ]
    return f"Beside friction: {'; '.join(clauses)}." if clauses else ""


def without_them(screening: Screening) -> str:
    """The S that a fit of S and J alone would give, where it differs by more than a third of S."""
    S, naive = finite(screening.S.value), _value(screening, "naive_S_percent")
    if S is None or naive is None or _NAIVE_SAID in screening.reason:
        return ""
    if abs(naive - S) <= max(NAIVE_SHARE * S, SMALLEST_NAIVE_STEP_PERCENT):
        return ""
    return f"{_NAIVE_SAID} would have read S {span_percent(naive)} %."


def _value(screening: Screening, name: str) -> float | None:
    indicator = screening.indicators.get(name)
    return None if indicator is None else finite(indicator.value)


def _interval_s(screening: Screening) -> float:
    return 1.0 if screening.seen is None else screening.seen.interval_s


def _time(screening: Screening, name: str) -> float | None:
    """The time, where the recording is sampled finely enough to show it; else ``None``."""
    value = _value(screening, name)
    if value is None or value < LEAST_SHARE_OF_INTERVAL * _interval_s(screening):
        return None
    return value


def _time_said(screening: Screening, value: float) -> str:
    interval_s = _interval_s(screening)
    return duration(value / interval_s, interval_s, ".1f")


def _late(screening: Screening) -> str:
    dead = _time(screening, "dead_time_s")
    return "" if dead is None else f"command arrives {_time_said(screening, dead)} late"


def _lag(screening: Screening) -> str:
    times = _time(screening, "lag_rising_s"), _time(screening, "lag_falling_s")
    return _two_ways(*times, lambda time: _time_said(screening, time), "follows with a lag of")


def _speed(screening: Screening) -> str:
    interval_s = _interval_s(screening)
    names = ("speed_rising_percent_per_s", "speed_falling_percent_per_s")
    fastest = FASTEST_PERCENT / min(interval_s, 1.0)
    speeds = [_value(screening, name) for name in names]
    slow = [speed if speed is not None and speed <= fastest else None for speed in speeds]

    def speed_text(speed: float) -> str:
        return rate(speed * interval_s, interval_s)

    return _two_ways(slow[0], slow[1], speed_text, "moves at most")


def _two_ways(
    rising: float | None, falling: float | None, as_text: Callable[[float], str], quantity: str
) -> str:
    if rising is None:
        return "" if falling is None else f"{quantity} {as_text(falling)} when position falls"
    if falling is None:
        return f"{quantity} {as_text(rising)} when position rises"
    if abs(rising - falling) <= ALIKE_SHARE * max(rising, falling):
        return f"{quantity} {as_text((rising + falling) / 2)}"
    return f"{quantity} {as_text(rising)} rising and {as_text(falling)} falling"
