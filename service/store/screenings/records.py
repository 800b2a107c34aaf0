"""Frozen values that the store returns: valves, runs, screenings, baselines, remarks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from typing import Protocol

from stemwatch.models.estimate import Estimate
from stemwatch.models.health_indicators.indicator_meanings import meaning_of
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.mismatch.open_question import OpenQuestion
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import Provenance
from stemwatch.models.screening_result import Indicator, Residual
from stemwatch.models.signals.position_histograms import PositionHistograms
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.models.verdict import NoVerdict, Shape, Verdict
from stemwatch.models.without_position.suspicion import WithoutPosition
from stemwatch.service.plant_path import HasPath, PlantPath, levels_of

UtcWindow = tuple[datetime | None, datetime | None]  # start and end, where known


class DescribedValve(HasPath, Protocol):
    """A valve's description as the store needs it; the plant file's ``Valve`` fulfils it."""

    @property
    def id(self) -> str: ...
    @property
    def description(self) -> str: ...
    @property
    def criticality(self) -> int: ...


@dataclass(frozen=True, kw_only=True)
class StoredValve(PlantPath):
    """A valve; ``criticality`` 1 to 3, 3 the valve the plant can least do without."""

    id: str
    description: str = ""
    criticality: int = 2

    @classmethod
    def of(cls, valve: DescribedValve) -> StoredValve:
        """What the plant file says of ``valve``."""
        return cls(
            id=valve.id,
            description=valve.description,
            criticality=valve.criticality,
            **levels_of(valve),
        )


class RunState(StrEnum):
    """How far a run has come, from the queue to its end."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    CANCELLED = "cancelled"
    FAILED = "failed"  # an error ended it; ``reason`` says which
    SKIPPED = "skipped"  # the previous run of the schedule was not over


class ValveState(StrEnum):
    """The state of one valve of a run."""

    PENDING = "pending"
    DONE = "done"
    SET_ASIDE = "set_aside"  # it failed or took too long; ``reason`` says which


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """One run; ``finished`` is ``None`` while it waits or runs, or where it was interrupted.

    ``schedule`` and ``due`` are ``None`` for a run that ``who`` requested. ``done`` of ``total``
    valves are done, ``set_aside`` of them without a result. ``asked`` names the requested valves;
    empty where the schedule decides. ``report`` is the folder of its report.
    """

    id: int
    started: datetime
    finished: datetime | None
    command: str
    software_version: str
    settings_digest: str
    counts: Mapping[Verdict, int]
    state: RunState = RunState.DONE
    schedule: str | None = None
    due: datetime | None = None
    window: UtcWindow = (None, None)
    asked: tuple[str, ...] = ()
    who: str = ""
    total: int = 0
    done: int = 0
    set_aside: int = 0
    heartbeat: datetime | None = None
    cancel_asked_by: str | None = None
    reason: str = ""
    report: str | None = None

    def left_s(self, now: datetime) -> float | None:
        """Estimated seconds until the end, from the time that the finished valves took; ``None``
        before the first one is done."""
        if self.state is not RunState.RUNNING or not 0 < self.done <= self.total:
            return None
        return (now - self.started).total_seconds() * (self.total - self.done) / self.done


@dataclass(frozen=True, kw_only=True)
class EarlierCurve:
    """The curve from OP to stroke found in one window (UTC); ``None`` where travel was
    proportional to OP."""

    start: datetime
    end: datetime
    curve: StrokeCurve | None


@dataclass(frozen=True, kw_only=True)
class EarlierAnswer:
    """What OP and PV alone said of the loop in one window (UTC), and in which screening of it."""

    screening: int
    start: datetime
    end: datetime
    answer: WithoutPosition


@dataclass(frozen=True, kw_only=True)
class StoredScreening:
    """A ``Screening`` as it was saved: everything except samples, traces and the network.

    ``at`` is the end of its window, or the time of saving where the source has no dates. Residuals
    that were not finite are NaN. ``baseline_id`` is the baseline that the indicators refer to
    (``Baseline.id``). ``held_back`` says why the named effects do not stand among all valves of the
    run; empty where they do. ``confirmed`` are the slugs that the windows of weeks confirm and that
    stand, ``None`` where the valve had no history that decides.
    """

    id: int
    valve: str
    run_id: int
    window: UtcWindow
    at: datetime
    verdict: Verdict
    reason: str
    advice: str
    shape: Shape | None
    severity: float
    confidence: float | None
    S: Estimate
    J: Estimate
    residuals: Mapping[str, Residual | None]
    quality: DataQuality
    still_seen: tuple[str, ...]
    baseline_note: str
    provenance: Provenance
    software_version: str
    settings_digest: str
    seconds: float
    no_verdict: NoVerdict | None = None
    baseline_id: int | None = None
    without_position: WithoutPosition | None = None
    histograms: PositionHistograms | None = None
    mismatch: Mismatch | None = None
    open_question: OpenQuestion | None = None
    held_back: str = ""
    confirmed: tuple[str, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class JudgedScreening:
    """What the alert rules need of a stored screening. ``S`` and ``J`` in percent of OP span.

    ``named``: an effect beside S and J was named, and a defect stands among all valves of the run;
    ``mismatch`` describes it, and is read for the newest screening only. ``without_position`` is
    read where there is no verdict.
    """

    id: int
    run_id: int
    window: UtcWindow
    verdict: Verdict
    reason: str
    advice: str
    severity: float
    S: Estimate
    J: float | None
    shape: Shape | None = None
    named: bool = False
    mismatch: Mismatch | None = None
    without_position: WithoutPosition | None = None


@dataclass(frozen=True, kw_only=True)
class RecentOfValve:
    """The last screenings of one valve, newest first, and what alert rules compare them with.

    ``at_baseline`` is S in the baseline's window, percent of OP span; ``indicator`` the values of
    one indicator by screening id; ``worked_at`` the instants of maintenance.
    """

    screenings: Sequence[JudgedScreening] = ()
    at_baseline: Estimate | None = None
    indicator: Mapping[int, float] = field(default_factory=dict)
    worked_at: Sequence[datetime] = ()


@dataclass(frozen=True, kw_only=True)
class TrendPoint:
    """The value of an indicator at one screening, ``None`` where it was not finite, with its
    interval."""

    at: datetime
    value: float | None
    low: float | None
    high: float | None
    unit: str

    def indicator(self, name: str) -> Indicator:
        """As the indicator ``name`` with what it means; NaN where the store has no value."""
        meaning, worse = meaning_of(name)
        return Indicator(
            name=name,
            value=math.nan if self.value is None else self.value,
            unit=self.unit,
            meaning=meaning,
            worse=worse,
            low=self.low,
            high=self.high,
        )


@dataclass(frozen=True, kw_only=True)
class Remark:
    """A note about a valve, or maintenance of it."""

    valve: str
    at: datetime
    note: str
    who: str


# Of times that people and programs give: far beyond, a time in the plant's own zone may lie outside
# the calendar, and no page could show it.
EARLIEST, LATEST = datetime(1970, 1, 1, tzinfo=UTC), datetime(2200, 1, 1, tzinfo=UTC)


def no_time_of_a_plant(at: datetime) -> str:
    """Why ``at`` cannot be meant; empty where it can."""
    if EARLIEST <= at <= LATEST:
        return ""
    years = f"{EARLIEST.year} and {LATEST.year}"
    return f"a time between {years} is expected, received {at.isoformat()}"


def not_done_yet(at: datetime, now: datetime) -> str:
    """Why no work of ``at`` can be recorded at ``now``; empty where it is past. Until work that is
    yet to come no window would become the valve's baseline; an hour is left to clocks."""
    if at <= now + timedelta(hours=1):
        return ""
    return f"{at:%Y-%m-%d %H:%M %Z} has not come yet; give the time at which the work was done"


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """The network a valve is compared with. ``maintenance`` is the first maintenance after the
    baseline's window; from then on the baseline no longer describes the valve."""

    valve: str
    network: bytes
    created: datetime
    window: UtcWindow
    reason: str
    maintenance: Remark | None = None
    id: int = 0

    @property
    def note(self) -> str:
        """The baseline's reason, window and outdating maintenance, in one sentence."""
        text = f"Baseline: {self.reason}, {_span(self.window, self.created)}"
        if self.maintenance is None:
            return f"{text}."
        work = f"{self.maintenance.note} on {_day(self.maintenance.at)}"
        return f"{text}; it describes the valve before maintenance ({work})."


@dataclass(frozen=True, kw_only=True)
class SaveFailure:
    """A screening that was not saved, and why. ``place`` is that among all that were to be saved,
    where a valve may stand several times."""

    valve: str
    place: int
    reason: str


@dataclass(frozen=True, kw_only=True)
class SaveReport:
    """How many screenings were saved, and which were not."""

    saved: int
    failures: tuple[SaveFailure, ...] = ()


def _span(window: UtcWindow, created: datetime) -> str:
    start, end = window
    if start is None or end is None:
        return f"of unknown date, stored {_day(created)}"
    return f"{start:%Y-%m-%d %H:%M} to {end:%Y-%m-%d %H:%M} UTC"


def _day(instant: datetime) -> str:
    return f"{instant:%Y-%m-%d}"
