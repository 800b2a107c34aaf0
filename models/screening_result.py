"""``Screening``: the result for one valve and one window. Report and store read this."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.mismatch.open_question import OpenQuestion
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.preparation.fit_window import on_whole_clock
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import Floats, Provenance, Recording, Role
from stemwatch.models.signals.position_histograms import PositionHistograms
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.models.verdict import NoVerdict, Shape, Verdict
from stemwatch.models.without_position.suspicion import WithoutPosition


@dataclass(frozen=True, kw_only=True)
class Residual:
    """How well a model's free run follows MV on samples it was not fitted to.

    ``rmse`` in percent of span, ``normalised`` = rmse / standard deviation of MV there, so that
    1 is no better than a constant. ``one_step`` is the one-step-ahead rmse (NARX only).
    """

    rmse: float
    normalised: float
    one_step: float | None = None

    @property
    def fit_percent(self) -> float:
        """100 (1 - ||y - yhat|| / ||y - mean(y)||)."""
        return 100.0 * (1.0 - self.normalised)


@dataclass(frozen=True, kw_only=True)
class Indicator:
    """One number a planner can trend, with its unit, its meaning, and which direction is worse."""

    name: str  # a stable identifier, snake_case, the unit at its end where it has one
    value: float
    unit: str
    meaning: str
    worse: str = "up"  # "up", "down" or "none"
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, kw_only=True)
class Traces:
    """Simulated stem positions on the recording's clock, for the plots; NaN where not simulated."""

    stiction: Floats | None = None  # (n,) free run of the stick-slip model, percent of travel
    narx: Floats | None = None  # (n,) free run of the NARX network, percent of travel
    heldout_from: int | None = None  # first sample of the part that no model was fitted to

    def within(self, first: int, samples: int) -> Traces:
        """The traces on the clock of a recording of ``samples`` samples, of which they begin at
        ``first``; NaN outside."""
        stiction, narx, heldout = self.stiction, self.narx, self.heldout_from
        return Traces(
            stiction=None if stiction is None else on_whole_clock(stiction, first, samples),
            narx=None if narx is None else on_whole_clock(narx, first, samples),
            heldout_from=None if heldout is None else first + heldout,
        )


@dataclass(frozen=True, kw_only=True)
class RecordingFacts:
    """The facts that are kept of a recording whose samples were dropped.

    ``tags`` has (tag, unit) of each role; ``zone`` is how times became UTC.
    """

    start: datetime | None
    end: datetime | None
    interval_s: float
    samples: int
    usable_share: float
    tags: Mapping[Role, tuple[str, str]]
    zone: str = ""

    @classmethod
    def of(cls, recording: Recording) -> RecordingFacts:
        """What is known of ``recording``."""
        return cls(
            start=recording.start,
            end=recording.end,
            interval_s=recording.interval_s,
            samples=len(recording),
            usable_share=float(np.mean(recording.usable)) if len(recording) else 0.0,
            tags={role: (signal.tag, signal.unit) for role, signal in recording.signals.items()},
            zone=recording.clock.zone,
        )

    @property
    def duration_s(self) -> float:
        """Seconds from the first sample to just after the last."""
        return self.samples * self.interval_s


def _empty_traces() -> Traces:
    return Traces()


@dataclass(frozen=True, kw_only=True, repr=False)
class Screening:
    """One valve, one window: verdict, numbers, evidence, and where they came from."""

    valve: str
    verdict: Verdict
    reason: str  # one sentence that a maintenance planner understands
    advice: str  # what to do next, one sentence
    shape: Shape | None
    severity: float  # 0 to 100, for ranking
    confidence: float | None  # 0 to 1; None where there is no verdict
    S: Estimate  # dead band plus stick band, percent of OP span
    J: Estimate  # slip jump, percent of OP span
    residuals: Mapping[str, Residual | None]  # "stiction", "narx", "baseline"
    quality: DataQuality
    indicators: Mapping[str, Indicator]
    no_verdict: NoVerdict | None = None  # why it is undetermined
    still_seen: tuple[str, ...] = ()  # facts that hold without a verdict, one sentence each
    network: NarxNetwork | None = None
    baseline_note: str = ""  # which baseline the comparison refers to, or that there is none
    traces: Traces = field(default_factory=_empty_traces)
    recording: Recording | None = None  # None where nothing could be read, or it was dropped
    kept: RecordingFacts | None = None  # facts of the whole, where samples were dropped
    provenance: Provenance = field(default_factory=lambda: Provenance(source="memory"))
    mismatch: Mismatch | None = None  # what S and J leave out; None where nothing was fitted
    # OP, PV and noise for a test, where there is no ``mismatch`` that has them
    open_question: OpenQuestion | None = None
    # evidence from OP and PV alone; None: not computed
    without_position: WithoutPosition | None = None
    stroke_curve: StrokeCurve | None = None  # where OP is not percent for percent of travel
    histograms: PositionHistograms | None = None  # where the stem stood; None without a position
    outside_window: bool = False  # readable, but without a sample in the window asked for
    changed: str = ""  # what differs from the window before, such as the curve from OP to stroke
    seconds: float = 0.0

    def __repr__(self) -> str:
        numbers = "" if self.S.value is None else f"; S {self.S}, J {self.J}"
        return f"{self.valve}: {self.verdict.value}, severity {self.severity:.0f}{numbers}"

    @property
    def window(self) -> tuple[datetime | None, datetime | None]:
        """UTC start and end, ``None`` where the source does not give them."""
        seen = self.recording if self.kept is None else self.kept
        return (None, None) if seen is None else (seen.start, seen.end)

    @property
    def seen(self) -> RecordingFacts | None:
        """What is known of the recording; ``None`` where the source could not be read at all."""
        if self.kept is not None or self.recording is None:
            return self.kept
        return RecordingFacts.of(self.recording)

    @property
    def was_read(self) -> bool:
        """Whether the source could be read at all."""
        return self.seen is not None or bool(self.still_seen)

    def finite_share(self) -> float:
        """Share of samples a fit could use."""
        seen = self.seen
        return 0.0 if seen is None else seen.usable_share

    def with_indicators(self, indicators: Iterable[Indicator]) -> Screening:
        """The same result with these indicators as well."""
        named = {indicator.name: indicator for indicator in indicators}
        return replace(self, indicators={**self.indicators, **named})

    def without_samples(self) -> Screening:
        """The same result without a single sample: no recording, no traces, no free runs, no
        picture of a suspicion.

        A day of a valve at 1 s takes some 6 MB, its findings some 30 KB.
        """
        short = self.excerpt(0, 0)
        return replace(short, recording=None, traces=Traces())

    def excerpt(self, first: int, last: int) -> Screening:
        """The same result with samples ``first`` (inclusive) to ``last`` (exclusive) only.

        ``kept`` then holds the facts of the whole recording.
        """
        if self.recording is None:
            return self
        traces, mismatch = self.traces, self.mismatch
        runs = None if mismatch is None else mismatch.runs
        if mismatch is not None and runs is not None:
            part = runs.part(first, last) if last > first else None
            mismatch = replace(mismatch, runs=part)
        suspicion = self.without_position
        if suspicion is not None and suspicion.traces is not None:
            suspicion = replace(
                suspicion, traces=suspicion.traces.part(first, last) if last > first else None
            )
        heldout = traces.heldout_from
        return replace(
            self,
            recording=self.recording.part(first, last),
            kept=self.seen,
            traces=Traces(
                stiction=None if traces.stiction is None else _copy(traces.stiction, first, last),
                narx=None if traces.narx is None else _copy(traces.narx, first, last),
                heldout_from=None if heldout is None else max(heldout - first, 0),
            ),
            mismatch=mismatch,
            without_position=suspicion,
        )


@dataclass(frozen=True, kw_only=True)
class PreviousFinding:
    """The result of an earlier screening of the valve.

    ``at`` is its time (the end of its window, or when it was saved), ``run`` the number of its run.
    ``S`` and ``J`` in percent of OP span, ``None`` where they were not known. ``finding`` is a
    value of ``mismatch.findings.Finding``, ``effects`` the slugs that were named, then or over the
    windows of weeks; ``defects`` those of them that were confirmed and need work.
    """

    at: datetime
    run: int
    verdict: Verdict
    severity: float = 0.0  # 0 to 100
    S: float | None = None
    J: float | None = None
    finding: str | None = None
    effects: tuple[str, ...] = ()
    defects: tuple[str, ...] | None = None  # ``None``: all


def _copy(trace: Floats, first: int, last: int) -> Floats:
    """A copy of a part, so that the whole array can be freed."""
    return trace[first:last].copy()
