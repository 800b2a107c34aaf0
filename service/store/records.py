"""What the store gives back: plain frozen values, no rows and no sessions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Protocol

from stemwatch.models.estimate import Estimate
from stemwatch.models.findings import DataQuality, Residual
from stemwatch.models.recording import Provenance
from stemwatch.models.verdict import Shape, Verdict


class ValveFacts(Protocol):
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


@dataclass(frozen=True, kw_only=True)
class StoredRun:
    """One run; ``finished`` is ``None`` while it goes on, or where it was cut short."""

    id: int
    started: datetime
    finished: datetime | None
    command: str
    software_version: str
    settings_digest: str
    counts: Mapping[Verdict, int]


@dataclass(frozen=True, kw_only=True)
class StoredScreening:
    """A ``Screening`` as it was saved: everything but samples, traces and the network.

    ``at`` is the instant it speaks for: the end of its window, or when it was saved where the
    source does not tell its dates. A residual's number that was not finite comes back as NaN.
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
