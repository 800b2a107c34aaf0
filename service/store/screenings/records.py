"""What the store gives back: plain frozen values, no rows and no sessions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from typing import Protocol

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.recording import Provenance
from stemwatch.models.screening_result import DataQuality, Residual
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.models.verdict import Shape, Verdict


class DescribedValve(Protocol):
    """What the store keeps of a valve; a plant file's ``Valve`` is one."""

    @property
    def id(self) -> str: ...
    @property
    def description(self) -> str: ...
    @property
    def area(self) -> str: ...
    @property
    def criticality(self) -> int: ...


@dataclass(frozen=True, kw_only=True)
class StoredValve:
    """A valve; ``criticality`` 1 to 3, 3 the valve the plant can least do without."""

    id: str
    description: str = ""
    area: str = ""
    criticality: int = 2


class RunState(StrEnum):
    """Where a run is between being due and being over."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    CANCELLED = "cancelled"
    FAILED = "failed"  # it could not be worked on at all; the reason says why
    SKIPPED = "skipped"  # the schedule's run before was not over


class ValveState(StrEnum):
    """What became of one valve of a run."""

    PENDING = "pending"
    DONE = "done"
    SET_ASIDE = "set_aside"  # it failed or took too long; the reason says which


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """One run; ``finished`` is ``None`` while it waits or goes on, or where it was cut short.

    ``schedule`` and ``due`` are ``None`` for a run that ``who`` asked for. ``done`` of ``total``
    valves are done, ``set_aside`` of them without a result. ``asked`` names the valves where it is
    not what the schedule says. ``report`` is the folder of its report.
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
    window: tuple[datetime | None, datetime | None] = (None, None)
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
        """Seconds to go if the valves that are left take as long as those that are done; ``None``
        where nothing tells."""
        if self.state is not RunState.RUNNING or not 0 < self.done <= self.total:
            return None
        return (now - self.started).total_seconds() * (self.total - self.done) / self.done


@dataclass(frozen=True, kw_only=True)
class EarlierCurve:
    """The curve from OP to stroke of one window, UTC; ``None`` where OP was percent for percent of
    travel."""

    start: datetime
    end: datetime
    curve: StrokeCurve | None


@dataclass(frozen=True, kw_only=True)
class StoredScreening:
    """A ``Screening`` as it was saved: everything but samples, traces and the network.

    ``at`` is the instant it speaks for: the end of its window, or when it was saved where the
    source does not tell its dates. A residual's number that was not finite comes back as NaN.
    ``baseline_id`` is the baseline that its indicators refer to (``Baseline.id``). ``held_back``
    says why ``mismatch`` does not stand among all valves of its run; empty where it does.
    """

    id: int
    valve: str
    run_id: int
    window: tuple[datetime | None, datetime | None]
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
    baseline_id: int | None = None
    mismatch: Mismatch | None = None
    held_back: str = ""


@dataclass(frozen=True, kw_only=True)
class JudgedScreening:
    """What the rules need of a stored screening. ``S`` and ``J`` in percent of OP span.

    ``named``: an effect beside S and J has a name and stands among all valves of the run;
    ``mismatch`` holds its words, of the newest screening alone.
    """

    id: int
    run_id: int
    window: tuple[datetime | None, datetime | None]
    verdict: Verdict
    reason: str
    advice: str
    severity: float
    S: Estimate
    J: float | None
    named: bool = False
    mismatch: Mismatch | None = None


@dataclass(frozen=True, kw_only=True)
class RecentOfValve:
    """The last screenings of one valve, newest first, with what they are compared with.

    ``at_baseline`` is S in the baseline's window, percent of OP span; ``indicator`` one indicator
    of each screening that has it, by the screening's id; ``worked_at`` when the valve was worked
    on.
    """

    screenings: Sequence[JudgedScreening] = ()
    at_baseline: Estimate | None = None
    indicator: Mapping[int, float] = field(default_factory=dict)
    worked_at: Sequence[datetime] = ()


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """One line of the ranking: a valve and its latest screening."""

    valve: StoredValve
    screening: StoredScreening


@dataclass(frozen=True, kw_only=True)
class TrendPoint:
    """One number of one screening; ``value`` is ``None`` where there was no finite one."""

    at: datetime
    value: float | None
    low: float | None
    high: float | None
    unit: str


@dataclass(frozen=True, kw_only=True)
class Remark:
    """A note on a valve, or work done on it."""

    valve: str
    at: datetime
    note: str
    who: str


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """The network a valve is compared with. ``maintenance`` is the first work on the valve after
    the baseline's window: from then on the baseline describes a valve that is no more."""

    valve: str
    network: bytes
    created: datetime
    window: tuple[datetime | None, datetime | None]
    reason: str
    maintenance: Remark | None = None
    id: int = 0
    active: bool = True

    @property
    def note(self) -> str:
        """Which baseline this is, in one sentence."""
        text = f"Baseline: {self.reason}, {_span(self.window, self.created)}"
        if self.maintenance is None:
            return f"{text}."
        work = f"{self.maintenance.note} on {_day(self.maintenance.at)}"
        return f"{text}; it describes the valve before maintenance ({work})."


@dataclass(frozen=True, kw_only=True)
class SaveFailure:
    """A screening that was not saved, and why."""

    valve: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class SaveReport:
    """What became of many screenings."""

    saved: int
    failures: tuple[SaveFailure, ...] = ()


def _span(window: tuple[datetime | None, datetime | None], created: datetime) -> str:
    start, end = window
    if start is None or end is None:
        return f"of unknown date, stored {_day(created)}"
    return f"{start:%Y-%m-%d %H:%M} to {end:%Y-%m-%d %H:%M} UTC"


def _day(instant: datetime) -> str:
    return f"{instant:%Y-%m-%d}"
