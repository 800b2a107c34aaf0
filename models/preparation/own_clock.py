"""Time in units of the recording's own clock, on which everything is fitted, named and limited.

What a recording can show depends on its samples, not on the length of a second: a lag of two
samples is as clear at 1 kHz as at one sample a minute. So ``screen`` and ``explain`` first convert
a recording to its own clock (``on_own_clock``). Its unit is the sample, or several samples where
the valve takes dozens to answer (``stickslip.own_unit``). Grids, blocks, limits and starts are in
this unit, and "seconds" inside the fits are such units. A recording with a sample every second is
on its own clock already, without any rounding.

Results of ``screen`` and ``explain`` are in seconds again: numbers are converted by ``seconds_of``,
by their unit; times in sentences by ``duration`` and ``rate``, or a ``SpokenEstimate``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.preparation.own_unit import samples_in_unit
from stemwatch.models.recording import Recording

# The power of time in each unit that a result may have.
POWER_OF_TIME: Mapping[str, int] = MappingProxyType(
    {"": 0, "%": 0, "s": 1, "%/s": -1, "rad/s": -1, "1/h": -1, "%/h": -1}
)
# Units for times on a fast and on a slow clock; between FAST and SLOW times are said in seconds.
FAST, SLOW = 0.5, 2.0  # seconds in the unit
_FINE = ((1.0, "s"), (1e-3, "ms"))
_COARSE = ((86400.0, "d"), (3600.0, "h"), (60.0, "min"), (1.0, "s"))
LEAST_SAID = 2.0  # of a unit longer than a second, from which it is used: "90 s", not "1.5 min"


def on_own_clock(recording: Recording) -> Recording:
    """``recording`` with its times in units of its own clock; itself where they already are."""
    if recording.own_unit_s is not None:
        return recording
    unit_s = samples_in_unit(recording) * recording.interval_s
    return replace(_in_unit(recording, unit_s), own_unit_s=unit_s)


def _in_unit(recording: Recording, unit_s: float) -> Recording:
    """``recording`` with all its times divided by ``unit_s``."""
    signals = {
        role: signal
        if signal.interval_s is None
        else replace(signal, interval_s=signal.interval_s / unit_s)
        for role, signal in recording.signals.items()
    }
    clock = replace(
        recording.clock,
        jitter_s=recording.clock.jitter_s / unit_s,
        longest_gap_s=recording.clock.longest_gap_s / unit_s,
    )
    return replace(
        recording, signals=signals, interval_s=recording.interval_s / unit_s, clock=clock
    )


def off_own_clock(recording: Recording) -> Recording:
    """``recording`` with its times in seconds again."""
    unit_s = recording.own_unit_s
    if unit_s is None:
        return recording
    return replace(_in_unit(recording, 1.0 / unit_s), own_unit_s=None)


def seconds_of(value: float, unit: str, unit_s: float) -> float:
    """``value`` in true units of time: its ``unit`` names seconds or hours, but it was counted in
    units of ``unit_s`` seconds. Raises ``ValueError`` for an unknown unit.
    """
    power = POWER_OF_TIME.get(unit)
    if power is None:
        known_quantities = ", ".join(repr(quantity) for quantity in POWER_OF_TIME)
        raise ValueError(
            f"the unit {unit!r} has no power of time: one of {known_quantities} expected; add "
            "it to POWER_OF_TIME in models/preparation/own_clock.py"
        )
    return value if power == 0 else value * unit_s if power == 1 else value / unit_s


def estimate_in_seconds(estimate: Estimate, unit_s: float) -> Estimate:
    """``estimate`` of the own clock in true units."""
    if estimate.value is None:
        return estimate
    value, low, high = (
        None if number is None else seconds_of(number, estimate.unit, unit_s)
        for number in (estimate.value, estimate.low, estimate.high)
    )
    return replace(estimate, value=value, low=low, high=high)


def duration(own_time: float, unit_s: float, spec: str = ".0f") -> str:
    """``own_time`` units of ``unit_s`` seconds in words: "12 s" by ``spec`` where the clock is one
    of seconds, "3.4 ms" on a faster and "2.5 h" on a slower one."""
    seconds = own_time * unit_s
    if is_of_seconds(unit_s):
        return f"{seconds:{spec}} s"
    factor, unit = _said_in(seconds, unit_s)
    return f"{seconds / factor:.3g} {unit}"


def period(own_time: float, unit_s: float) -> str:
    """A period in words, as ``duration``; on a clock of seconds in minutes from two of them on."""
    minutes = own_time * unit_s / 60.0
    if not is_of_seconds(unit_s) or minutes < 2.0:
        return duration(own_time, unit_s)
    return f"{minutes:.0f} min" if minutes >= 10.0 else f"{minutes:.2g} min"


def long_time(own_time: float, unit_s: float) -> str:
    """``own_time`` units of time in words: minutes on a clock of seconds."""
    return (
        f"{own_time * unit_s / 60.0:.0f} minutes"
        if is_of_seconds(unit_s)
        else duration(own_time, unit_s)
    )


def is_of_seconds(unit_s: float) -> bool:
    """True where a unit is about a second: not a fast clock, nor a slow one."""
    return FAST < unit_s < SLOW


def rate(own_rate: float, unit_s: float, spec: str = ".1f") -> str:
    """``own_rate`` percent a unit in words, as ``duration``: "0.5 %/s", "3 %/min"."""
    speed = own_rate / unit_s
    if is_of_seconds(unit_s):
        return f"{speed:{spec}} %/s"
    factor, unit = _speed_said_in(speed, unit_s)
    return f"{speed / factor:.3g} {unit}"


def between(low: str, high: str) -> str:
    """From one time or speed to another, in words: "4 to 12 s", "900 ms to 1.2 s"."""
    a, _, unit = low.rpartition(" ")
    return f"{a} to {high}" if high.endswith(f" {unit}") else f"{low} to {high}"


def parts_of_time(own_time: float, unit_s: float, parts: int) -> tuple[str, ...]:
    """Names of so many equal parts of ``own_time`` units of time: "minute 0 to 8" and so on."""
    seconds = own_time * unit_s
    factor, name = 60.0, "minute"
    if unit_s >= SLOW and seconds >= LEAST_SAID * 86400.0:
        factor, name = 3600.0, "hour"
    if unit_s <= FAST and seconds < 120.0:
        factor, name = (1.0, "second") if seconds >= 1.0 else (1e-3, "millisecond")
    edges = np.linspace(0.0, seconds / factor, parts + 1)
    digits = 0 if edges[-1] >= 30.0 else 1
    return tuple(f"{name} {a:.{digits}f} to {b:.{digits}f}" for a, b in pairwise(edges))


def _said_in(seconds: float, unit_s: float) -> tuple[float, str]:
    """The unit in which a time of a fast or of a slow clock is said, and its seconds."""
    if unit_s <= FAST:
        return _FINE[0] if seconds >= 1.0 else _FINE[1]
    return next(
        (coarse_unit for coarse_unit in _COARSE if seconds >= LEAST_SAID * coarse_unit[0]),
        _COARSE[-1],
    )


def _speed_said_in(speed: float, unit_s: float) -> tuple[float, str]:
    """As ``_said_in`` for percent a second."""
    if unit_s >= SLOW:
        return 1.0 / 60.0, "%/min"
    return (1000.0, "%/ms") if abs(speed) >= 1000.0 else (1.0, "%/s")


@dataclass(frozen=True, kw_only=True)
class SpokenEstimate(Estimate):
    """An estimate in units of the own clock, as a term compares it, that is said in true ones."""

    unit_s: float

    @classmethod
    def of(cls, estimate: Estimate, unit_s: float) -> SpokenEstimate:
        """``estimate``, of the own clock with units of ``unit_s`` seconds."""
        return cls(unit_s=unit_s, **{f.name: getattr(estimate, f.name) for f in fields(Estimate)})

    def __str__(self) -> str:
        estimate = Estimate(**{f.name: getattr(self, f.name) for f in fields(Estimate)})
        in_seconds = estimate_in_seconds(estimate, self.unit_s)
        if in_seconds.value is None or is_of_seconds(self.unit_s):
            return str(in_seconds)
        if self.unit == "s":
            longest = max(in_seconds.value, in_seconds.high or 0.0)
            factor, unit = _said_in(longest, self.unit_s)
        elif self.unit == "%/s":
            factor, unit = _speed_said_in(in_seconds.value, self.unit_s)
        else:
            return str(in_seconds)
        value, low, high = (
            None if number is None else number / factor
            for number in (in_seconds.value, in_seconds.low, in_seconds.high)
        )
        return str(replace(in_seconds, value=value, low=low, high=high, unit=unit))
