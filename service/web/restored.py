"""Stored rows as the ``Screening`` that the report's templates show."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from stemwatch.models.findings import DataQuality, Indicator, Screening
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.report.context import PreviousFinding
from stemwatch.service.report.trend import Trend, trend
from stemwatch.service.store.records import StoredScreening, TrendPoint
from stemwatch.service.web.indicator_words import meaning
from stemwatch.service.web.queries.ranking import Line


@dataclass(frozen=True, kw_only=True)
class Restored(Screening):
    """A screening without its samples, which still knows its window."""

    stored_window: tuple[datetime | None, datetime | None] = (None, None)

    @property
    def window(self) -> tuple[datetime | None, datetime | None]:
        """UTC start and end, ``None`` where the source did not tell."""
        return self.stored_window


def screening_of(stored: StoredScreening, indicators: Mapping[str, TrendPoint]) -> Screening:
    """A stored screening with its indicators. Samples, traces and network are not kept there."""
    return Restored(
        valve=stored.valve,
        verdict=stored.verdict,
        reason=stored.reason,
        advice=stored.advice,
        shape=stored.shape,
        severity=stored.severity,
        confidence=stored.confidence,
        S=stored.S,
        J=stored.J,
        residuals=stored.residuals,
        quality=stored.quality,
        indicators={name: _indicator(name, point) for name, point in indicators.items()},
        still_seen=stored.still_seen,
        baseline_note=stored.baseline_note,
        provenance=stored.provenance,
        mismatch=stored.mismatch,
        seconds=stored.seconds,
        stored_window=stored.window,
    )


def finding_of(stored: StoredScreening) -> PreviousFinding:
    """A stored screening as what the next one is compared with."""
    return PreviousFinding(
        verdict=stored.verdict,
        S=stored.S.value,
        J=stored.J.value,
        severity=stored.severity,
        started=stored.at,
    )


def trend_of_line(line: Line) -> Trend | None:
    """The change since the screening before; ``None`` for a valve that was not screened yet."""
    if line.verdict is None:
        return None
    return trend(_screening_of_line(line, line.verdict), line.previous)


def _screening_of_line(line: Line, verdict: Verdict) -> Screening:
    return Screening(
        valve=line.valve,
        verdict=verdict,
        reason="",
        advice="",
        shape=None if line.shape is None else Shape(line.shape),
        severity=line.severity,
        confidence=line.confidence,
        S=line.S,
        J=line.J,
        residuals={},
        quality=DataQuality(grade=line.grade),
        indicators={},
    )


def _indicator(name: str, point: TrendPoint) -> Indicator:
    says, worse = meaning(name)
    return Indicator(
        name=name,
        value=math.nan if point.value is None else point.value,
        unit=point.unit,
        meaning=says,
        worse=worse,
        low=point.low,
        high=point.high,
    )
