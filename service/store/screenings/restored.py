"""What is stored of a screening, as the nouns that reports are made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from stemwatch.models.screening_result import Indicator, Screening
from stemwatch.service.store.screenings.records import StoredScreening


@dataclass(frozen=True, kw_only=True)
class Restored(Screening):
    """A screening as the store has it: without its samples, but with its window."""

    stored_window: tuple[datetime | None, datetime | None] = (None, None)

    @property
    def window(self) -> tuple[datetime | None, datetime | None]:
        """UTC start and end, ``None`` where the source did not tell."""
        return self.stored_window


def screening_of(
    stored: StoredScreening, indicators: Mapping[str, Indicator] | None = None
) -> Restored:
    """A stored screening, with its indicators where they are wanted and were read.

    Samples, traces and networks are not kept with it.
    """
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
        indicators=indicators or {},
        still_seen=stored.still_seen,
        baseline_note=stored.baseline_note,
        provenance=stored.provenance,
        mismatch=stored.mismatch,
        seconds=stored.seconds,
        stored_window=stored.window,
    )
