"""``PlantLoop``: the full description of one simulated control loop, without random numbers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum

from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator.defects import Upsets
from stemwatch.models.studies.simulator.valve import SimulatedValve


class ProcessKind(StrEnum):
    """The kind of process variable."""

    FLOW = "flow"
    PRESSURE = "pressure"
    TEMPERATURE = "temperature"
    CONCENTRATION = "concentration"
    LEVEL = "level"


class LoadKind(StrEnum):
    """What the disturbance looks like; see ``Load``."""

    COLOURED = "coloured"
    OSCILLATING = "oscillating"
    STEPS = "steps"


class CompressionKind(StrEnum):
    """How an archive thins a column; see ``Compression``."""

    SWINGING_DOOR = "swinging door"
    EXCEPTION = "exception"


@dataclass(frozen=True, kw_only=True)
class Process:
    """From stem position to process variable.

    Self-regulating: ``PV = PV0 + gain e^(-dead_time s) (x - x0 + load) / ((lag s + 1)(second_lag
    s + 1))``, gain in percent of PV per percent of travel. Integrating: ``gain/s`` in place of the
    first lag, gain in percent of PV per second per percent of travel.
    """

    kind: ProcessKind = ProcessKind.FLOW
    gain: float = 1.0
    lag_s: float = 2.0
    second_lag_s: float = 0.0
    dead_time_s: float = 1.0
    integrating: bool = False


@dataclass(frozen=True, kw_only=True)
class Controller:
    """PI or PID in positional form: ``OP = gain (e + integral of e / reset + derivative)``.

    The output is limited, the integral is set back to what the limited output implies, and OP is
    held for ``scan_s``. The derivative acts on PV through a lag of ``derivative_s / 8``.
    ``set_point`` and ``output`` are where the loop stands in balance at time zero, percent.
    """

    gain: float = 0.4
    reset_s: float = 6.0
    derivative_s: float = 0.0
    scan_s: float = 0.5
    output_low: float = 0.0
    output_high: float = 100.0
    set_point: float = 50.0
    output: float = 50.0


@dataclass(frozen=True, kw_only=True)
class Load:
    """A disturbance at the process input, in percent of valve travel.

    ``size`` is the standard deviation (coloured: first-order noise of correlation time ``time_s``),
    the amplitude (oscillating: period ``time_s``, its phase a random walk that gains ``drift_rad``
    in standard deviation per period), or the standard deviation of the height (steps, one every
    ``time_s`` on average).
    """

    kind: LoadKind
    size: float
    time_s: float
    drift_rad: float = 0.2


@dataclass(frozen=True, kw_only=True)
class ManualSpan:
    """Controller in manual between two times; OP follows the line through ``knots``.

    Each knot is (time in s, OP in percent); without knots OP stays where it was. Times count from
    the start of the recording.
    """

    start_s: float
    stop_s: float
    knots: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Transmitters:
    """Errors of the measurements: white noise (standard deviation), zero and span errors, and
    resolution, all in percent. The position reads ``span (x - 50) + 50 + zero``. A ``step`` of 0 is
    no rounding.

    ``position_play`` is the lost motion between stem and sensor, percent of travel from end to end
    of the play; ``position_bow`` the height of an S-shaped error of the linkage that vanishes at
    both ends and in the middle; ``position_drift`` what the reading has gained at the end of the
    record, evenly; ``position_walk`` the standard deviation there of a random walk.
    """

    pv_noise: float = 0.05
    position_noise: float = 0.03
    position_zero: float = 0.0
    position_span: float = 1.0
    position_step: float = 0.0
    position_play: float = 0.0
    position_bow: float = 0.0
    position_drift: float = 0.0
    position_walk: float = 0.0
    op_step: float = 0.0
    pv_step: float = 0.0
    has_position: bool = True


@dataclass(frozen=True, kw_only=True)
class Span:
    """A stretch of the record, seconds from its start; ``role`` ``None`` means every signal."""

    start_s: float
    stop_s: float
    role: Role | None = None


@dataclass(frozen=True, kw_only=True)
class Compression:
    """A column that the archive thins to a deviation in percent, and fills again when asked.

    A swinging door is filled by straight lines between the kept samples, exception reporting by
    holding the last kept one; neither is marked in the quality, as in real archives. Not
    ``filled``, the samples that were not kept are missing, as in an export of raw values.
    """

    role: Role
    kind: CompressionKind
    deviation: float
    filled: bool = True


@dataclass(frozen=True, kw_only=True)
class SimulatedArchive:
    """The historian: sampling interval, compression, frozen, missing and bad stretches.

    ``phase_s`` is how long after a whole interval the poll comes; at 0 it reads just before the
    controller's scan of the same instant, when OP has been held the longest. With
    ``position_jitter_s`` the position is read up to that much earlier than its even time stamp
    says, by chance; with ``average_s`` every signal is the mean over blocks of that length, held
    until the next.
    """

    interval_s: float = 1.0
    phase_s: float = 0.0
    position_jitter_s: float = 0.0
    average_s: float = 0.0
    compression: tuple[Compression, ...] = ()
    frozen: tuple[Span, ...] = ()
    gaps: tuple[Span, ...] = ()
    bad: tuple[Span, ...] = ()

    @property
    def uneven(self) -> bool:
        """Whether the plant must be sampled more than once in each interval."""
        return self.position_jitter_s > 0.0 or self.average_s > 0.0


@dataclass(frozen=True, kw_only=True)
class PvRange:
    """Engineering values of PV and SP at 0 and at 100 percent."""

    unit: str = "%"
    low: float = 0.0
    high: float = 100.0


@dataclass(frozen=True, kw_only=True)
class PlantLoop:
    """One control loop. ``setpoints`` are (time in s, set point in percent) steps; times count from
    the start of the recording, before which the loop settles for ``warmup_s``.

    Raises ``ValueError`` where a time that must be positive is not, or the record is shorter than
    two samples.
    """

    tag: str = "FIC-101"
    description: str = ""
    area: str = ""
    unit: str = ""
    price_per_unit_hour: float | None = None  # for an hour with PV one unit away from its set point
    criticality: int = 2
    story: str = ""  # what the loop demonstrates: "healthy, quiet", "sticky, undershoot"
    valve: SimulatedValve = field(default_factory=SimulatedValve)
    process: Process = field(default_factory=Process)
    controller: Controller = field(default_factory=Controller)
    transmitters: Transmitters = field(default_factory=Transmitters)
    archive: SimulatedArchive = field(default_factory=SimulatedArchive)
    pv_range: PvRange = field(default_factory=PvRange)
    loads: tuple[Load, ...] = ()
    setpoints: tuple[tuple[float, float], ...] = ()
    manual: tuple[ManualSpan, ...] = ()
    upsets: Upsets = field(default_factory=Upsets)
    duration_s: float = 3600.0
    warmup_s: float = 120.0

    def __post_init__(self) -> None:
        positive = {
            "process.lag_s": self.process.lag_s,
            "controller.reset_s": self.controller.reset_s,
            "controller.scan_s": self.controller.scan_s,
            "archive.interval_s": self.archive.interval_s,
            "valve.actuator.viscous_s": self.valve.actuator.viscous_s,
        }
        for name, value in positive.items():
            if value <= 0.0:
                raise ValueError(f"{self.tag}: {name} must be positive, received {value}")
        if self.duration_s < 2.0 * self.archive.interval_s:
            raise ValueError(
                f"{self.tag}: a recording needs at least two samples; received a duration of "
                f"{self.duration_s} s at an interval of {self.archive.interval_s} s"
            )

    def lasting(self, duration_s: float) -> PlantLoop:
        """The loop recorded for ``duration_s``, with its set points again and again, as often as
        the recording of now goes into it."""
        times = int(duration_s / self.duration_s)
        setpoints = tuple(
            (again * self.duration_s + at, value)
            for again in range(times)
            for at, value in self.setpoints
        )
        return replace(self, duration_s=duration_s, setpoints=setpoints)
