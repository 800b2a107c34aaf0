"""``Screening``: everything one look at one valve's recording found. Report and store read this."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.recording import Floats, Provenance, Recording
from stemwatch.models.verdict import Shape, Verdict


@dataclass(frozen=True, kw_only=True)
class DataQuality:
    """How far the recording itself can be trusted: grade A (clean) to D (no verdict possible)."""

    grade: str
    reasons: tuple[str, ...] = ()


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


def _empty_traces() -> Traces:
    return Traces()


@dataclass(frozen=True, kw_only=True)
class Screening:
    """One valve, one window: verdict, numbers, evidence, and where they came from."""

    valve: str
    verdict: Verdict
    reason: str  # one sentence that a maintenance planner understands
    advice: str  # what to do next, one sentence
    shape: Shape | None
    severity: float  # 0 to 100, for ranking
    confidence: float | None  # 0 to 1; None where there is no verdict
    S: Estimate  # deadband plus stickband, percent of OP span
    J: Estimate  # slip jump, percent of OP span
    residuals: Mapping[str, Residual | None]  # "stiction", "narx", "baseline"
    quality: DataQuality
    indicators: Mapping[str, Indicator]
    still_seen: tuple[str, ...] = ()  # what can be said without a verdict, one sentence each
    network: NarxNetwork | None = None
    baseline_note: str = ""  # which baseline the comparison refers to, or that there is none
    traces: Traces = field(default_factory=_empty_traces)
    recording: Recording | None = None  # None where the source could not be read at all
    provenance: Provenance = field(default_factory=lambda: Provenance(source="memory"))
    mismatch: Mismatch | None = None  # what S and J leave out; None where nothing was fitted
    seconds: float = 0.0

    @property
    def window(self) -> tuple[datetime | None, datetime | None]:
        """UTC start and end, ``None`` where the source does not tell."""
        if self.recording is None:
            return None, None
        return self.recording.start, self.recording.end

    def finite_share(self) -> float:
        """Share of samples a fit could use."""
        return 0.0 if self.recording is None else float(np.mean(self.recording.usable))
