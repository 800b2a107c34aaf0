"""``Recording``: one valve's signals on one clock. The rest of the code never sees files.

Every signal is a pair of arrays of the same length: ``values`` (NaN wherever there is no good
value) and ``quality`` (why). A gap in the source is a gap here; nothing is interpolated but the
lines of an archive that stored their ends alone (``Signal.deviation``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime, timedelta
from enum import IntEnum, StrEnum
from functools import cached_property, wraps
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
QualityCodes = NDArray[np.uint8]

PERCENT = "%"

T = TypeVar("T")


class Role(StrEnum):
    """The role of a signal in its loop."""

    OP = "op"  # controller output, the command to the valve
    MV = "mv"  # measured valve position (stem or flow standing for it); never guessed from a tag
    PV = "pv"  # process variable, the controlled measurement
    SP = "sp"  # set point
    MODE = "mode"  # controller mode: 1 automatic, 0 manual


class Quality(IntEnum):
    """Whether a sample is good, and if not, why."""

    GOOD = 0
    HELD = 1  # the archive repeated the last value and says so
    BAD = 2  # a status word or a quality code said bad
    MISSING = 3  # no sample at this instant: a gap in the source
    CODE = 4  # a state code in a value slot (a denormal float, a digital state number)
    RANGE = 5  # outside what the signal can be


@dataclass(frozen=True)
class ProcessRange:
    """The engineering values at 0 % and 100 % of a signal that is kept as percent, and their unit;
    for example 0 to 16 bar.
    """

    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Signal:
    """One role's samples.

    ``values`` (n,) float64, NaN where ``quality`` is not GOOD or HELD; ``quality`` (n,) uint8 of
    ``Quality``. ``unit`` is ``%`` when the values are percent of span or of travel. ``interval_s``
    is the signal's own rate of change in the source where that is slower than the clock's.
    ``scaled`` is set where the plant stated the values at 0 and 100 %, which then hold. ``range``
    has the engineering values behind the percent, where the plant file gives them. ``deviation``
    is set where only the corners of a swinging door were stored: ``values`` are on the lines
    between them, and the signal lay within so much of these, in its unit.
    """

    values: Floats
    quality: QualityCodes
    tag: str
    unit: str = PERCENT
    interval_s: float | None = None
    range: ProcessRange | None = None
    scaled: bool = False
    deviation: float | None = None

    def __post_init__(self) -> None:
        values = np.ascontiguousarray(self.values, dtype=np.float64)
        quality = np.ascontiguousarray(self.quality, dtype=np.uint8)
        if values.ndim != 1 or values.shape != quality.shape:
            raise ValueError(
                f"{self.tag}: values and quality must be one-dimensional and equally long; "
                f"received shapes {values.shape} and {quality.shape}"
            )
        values = np.where(quality <= Quality.HELD, values, np.nan)
        values.flags.writeable = False
        quality.flags.writeable = False
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "quality", quality)

    @classmethod
    def good(cls, values: Floats, tag: str, unit: str = PERCENT) -> Signal:
        """A signal whose finite samples are all good; NaN becomes MISSING."""
        values = np.asarray(values, dtype=np.float64)
        quality = np.where(np.isfinite(values), Quality.GOOD, Quality.MISSING)
        return cls(values=values, quality=quality.astype(np.uint8), tag=tag, unit=unit)

    def __getstate__(self) -> dict[str, object]:
        # Cached properties are not pickled.
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def in_process_unit(self) -> Signal:
        """The signal in its engineering unit (bar, t/h, °C), where its range is known; else
        unchanged.
        """
        if self.range is None:
            return self
        low, high = self.range.low, self.range.high
        values = low + self.values / 100.0 * (high - low)
        deviation = self.deviation
        if deviation is not None:
            deviation *= abs(high - low) / 100.0
        return replace(self, values=values, unit=self.range.unit, range=None, deviation=deviation)

    @cached_property
    def usable(self) -> Bools:
        """(n,) True where a fit may use the sample: good and finite. Read-only."""
        return _read_only((self.quality == Quality.GOOD) & np.isfinite(self.values))


@dataclass(frozen=True, kw_only=True)
class ClockFacts:
    """Irregularities of the source's time stamps, before samples were put on the even clock."""

    jitter_s: float = 0.0  # median absolute deviation of the steps from the interval
    gaps: int = 0  # steps longer than 1.5 intervals
    longest_gap_s: float = 0.0
    repeated_times: int = 0
    backward_steps: int = 0
    zone: str = ""  # how times became UTC, in one sentence; empty when the source had no times


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Where a recording came from."""

    source: str  # the path or address as the user gave it
    digest: str = ""  # sha256 of the source's bytes, hexadecimal
    layout: str = ""  # what the reader understood, in words
    decisions: tuple[str, ...] = ()  # each choice the reader made, one sentence each
    unused_options: tuple[str, ...] = ()  # those of the decisions on options without an effect
    position_question: str = ""  # which tag may be the position that was not read; else empty

    @property
    def remarks(self) -> tuple[str, ...]:
        """The decisions and the question, one sentence each."""
        return tuple(filter(None, (*self.decisions, self.position_question)))


@dataclass(frozen=True, kw_only=True, repr=False)
class Recording:
    """One valve's signals on one even clock of ``interval_s`` seconds.

    ``start`` is the UTC time of sample 0, or ``None`` where the source's zone is not known (then
    durations are right and the date is not). OP is always there; MV, PV, SP and mode may not be.
    ``recording.op.values`` (n,) is percent of span, ``recording.mv.values`` (n,) percent of travel,
    NaN wherever ``quality`` (n,) says why there is no good value; all arrays are read-only.
    ``len(recording)`` is n, ``recording.part(first, last)`` a stretch of it.
    Raises ``ValueError`` on unequal lengths, a naive start or an interval that is not positive.

    Example:
        >>> import numpy as np
        >>> from stemwatch.models.recording import Recording, Role, Signal
        >>> op = Signal.good(np.array([50.0, np.nan, 51.0]), "FIC101.OP")
        >>> Recording(valve="FIC-101", signals={Role.OP: op}, interval_s=1.0)
        FIC-101: op; 3 samples of 1 s (3 s), date not known, 66.6 % usable
    """

    valve: str
    signals: Mapping[Role, Signal]
    interval_s: float
    start: datetime | None = None
    clock: ClockFacts = field(default_factory=ClockFacts)
    provenance: Provenance = field(default_factory=lambda: Provenance(source="memory"))
    # Seconds in one unit of its own clock, where its times are counted in that (``own_clock``).
    own_unit_s: float | None = None

    def __post_init__(self) -> None:
        if Role.OP not in self.signals:
            raise ValueError(f"{self.valve}: a recording needs the controller output (OP)")
        lengths = {role.value: signal.values.size for role, signal in self.signals.items()}
        if len(set(lengths.values())) != 1:
            raise ValueError(f"{self.valve}: signals of one length expected, received {lengths}")
        if not (np.isfinite(self.interval_s) and self.interval_s > 0):
            raise ValueError(f"{self.valve}: interval_s must be positive: {self.interval_s}")
        if self.start is not None and self.start.tzinfo is None:
            raise ValueError(f"{self.valve}: start must be timezone aware, received {self.start}")
        if self.start is not None:
            object.__setattr__(self, "start", self.start.astimezone(UTC))
        object.__setattr__(self, "signals", MappingProxyType(dict(self.signals)))

    def __reduce__(self) -> tuple[object, ...]:
        # A mapping proxy cannot be pickled, and recordings travel to worker processes.
        state = {
            "valve": self.valve,
            "signals": dict(self.signals),
            "interval_s": self.interval_s,
            "start": self.start,
            "clock": self.clock,
            "provenance": self.provenance,
            "own_unit_s": self.own_unit_s,
        }
        return (_rebuild, (state,))

    def __repr__(self) -> str:
        roles = ", ".join(role.value for role in Role if role in self.signals)
        when = f" from {self.start:%Y-%m-%d %H:%M} UTC" if self.start else ", date not known"
        usable = np.floor(1000.0 * np.mean(self.usable)) / 10.0 if len(self) else 0.0
        return (
            f"{self.valve}: {roles}; {len(self)} samples of {self.interval_s * self.unit_s:g} s "
            f"({_rounded(self.duration_s * self.unit_s)}){when}, {usable:g} % usable"
        )

    def __len__(self) -> int:
        return int(self.signals[Role.OP].values.size)

    def get(self, role: Role) -> Signal | None:
        """The signal of ``role``, or ``None`` where the source has none."""
        return self.signals.get(role)

    @property
    def op(self) -> Signal:
        """The controller output, which every recording has."""
        return self.signals[Role.OP]

    @property
    def mv(self) -> Signal | None:
        """The valve position, or ``None`` where it is not recorded."""
        return self.signals.get(Role.MV)

    @property
    def pv(self) -> Signal | None:
        """The process variable, or ``None`` where it is not recorded."""
        return self.signals.get(Role.PV)

    @property
    def sp(self) -> Signal | None:
        """The set point, or ``None`` where it is not recorded."""
        return self.signals.get(Role.SP)

    @cached_property
    def usable(self) -> Bools:
        """(n,) True where OP and, if there is one, MV may be used by a fit. Read-only."""
        ok = self.op.usable
        return _read_only(ok & self.mv.usable) if self.mv is not None else ok

    @property
    def unit_s(self) -> float:
        """Seconds in the unit of its times: 1, except on its own clock (``own_clock``)."""
        return 1.0 if self.own_unit_s is None else self.own_unit_s

    @property
    def time_s(self) -> Floats:
        """(n,) seconds since the first sample."""
        return np.arange(len(self), dtype=np.float64) * self.interval_s

    @property
    def duration_s(self) -> float:
        """Seconds from the first sample to just after the last."""
        return len(self) * self.interval_s

    @property
    def end(self) -> datetime | None:
        """UTC time just after the last sample."""
        if self.start is None:
            return None
        return self.start + timedelta(seconds=self.duration_s * self.unit_s)

    def part(self, first: int, last: int) -> Recording:
        """Samples ``first`` (inclusive) to ``last`` (exclusive)."""
        signals = {
            role: replace(
                signal, values=signal.values[first:last], quality=signal.quality[first:last]
            )
            for role, signal in self.signals.items()
        }
        start = self.start
        if start is not None:
            start += timedelta(seconds=first * self.interval_s * self.unit_s)
        return replace(self, signals=signals, start=start)


def kept(function: Callable[[Recording], T]) -> Callable[[Recording], T]:
    """``function`` of a recording, computed once for each; a recording does not change."""
    name = f"{function.__module__}.{function.__qualname__}"

    @wraps(function)
    def once(recording: Recording) -> T:
        known = vars(recording)
        if name not in known:
            known[name] = function(recording)
        answer: T = known[name]
        return answer

    return once


def _rounded(seconds: float) -> str:
    """A duration in days, hours, minutes or seconds, whichever suits it."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2.0 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.3g} s"


def _read_only(flags: Bools) -> Bools:
    """``flags`` (n,) made read-only, since it is cached and shared."""
    flags.flags.writeable = False
    return flags


def _rebuild(state: dict[str, object]) -> Recording:
    return Recording(**state)  # type: ignore[arg-type]
