"""Stored screenings as ``Screening``, from which reports and pages are made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime

from sqlalchemy import ColumnElement, select
from sqlalchemy.orm import Session, defer, undefer

from stemwatch.models.mismatch.findings import Finding, Mismatch, Stiction
from stemwatch.models.screening_result import Indicator, Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.store.screenings.records import StoredScreening
from stemwatch.service.store.screenings.rows import stored_screening
from stemwatch.service.store.screenings.screenings import latest_screening_id
from stemwatch.service.store.screenings.tables import ScreeningRow, ValveRow


@dataclass(frozen=True, kw_only=True)
class Restored(Screening):
    """A screening from the store: without samples, with its window."""

    stored_window: tuple[datetime | None, datetime | None] = (None, None)

    @property
    def window(self) -> tuple[datetime | None, datetime | None]:
        """UTC start and end, ``None`` where the source has no dates."""
        return self.stored_window


def screening_of(
    stored: StoredScreening, indicators: Mapping[str, Indicator] | None = None
) -> Restored:
    """A stored screening as ``Screening``, without samples, traces and network; with ``indicators``
    where the caller has read them."""
    return Restored(
        valve=stored.valve,
        verdict=stored.verdict,
        reason=stored.reason,
        advice=stored.advice,
        shape=stored.shape,
        severity=stored.severity,
        confidence=stored.confidence,
        no_verdict=stored.no_verdict,
        S=stored.S,
        J=stored.J,
        residuals=stored.residuals,
        quality=stored.quality,
        indicators=indicators or {},
        still_seen=stored.still_seen,
        baseline_note=stored.baseline_note,
        provenance=stored.provenance,
        mismatch=stored.mismatch,
        open_question=stored.open_question,
        without_position=stored.without_position,
        histograms=stored.histograms,
        stroke_curve=None if stored.mismatch is None else stored.mismatch.stroke_curve,
        seconds=stored.seconds,
        stored_window=stored.window,
    )


def read_of_run(session: Session, run_id: int) -> list[Restored]:
    """Every screening of a run, by valve."""
    return _restored(session, ScreeningRow.run_id == run_id)


def read_latest_of_each(session: Session) -> list[Restored]:
    """Each valve's latest screening, by valve."""
    newest = select(latest_screening_id()).select_from(ValveRow)
    return _restored(session, ScreeningRow.id.in_(newest))


def _restored(session: Session, condition: ColumnElement[bool]) -> list[Restored]:
    statement = (
        select(ScreeningRow)
        .options(defer(ScreeningRow.mismatch), undefer(ScreeningRow.evidence))
        .where(condition)
    )
    rows = session.scalars(statement.order_by(ScreeningRow.valve, ScreeningRow.id))
    return [_of_row(row) for row in rows]


def _of_row(row: ScreeningRow) -> Restored:
    """The row as a screening. Of a healthy valve without a named effect, which gets no page, only
    the finding of the mismatch is read, since parsing thousands of mismatches is slow."""
    if row.verdict != Verdict.HEALTHY.value or row.mismatch_slugs:
        return screening_of(stored_screening(row))
    restored = screening_of(stored_screening(row, with_mismatch=False))
    if row.mismatch_finding is None:
        return restored
    numbers = Stiction(S=restored.S, J=restored.J)
    mismatch = Mismatch(
        finding=Finding(row.mismatch_finding), sentence="", naive=numbers, restated=numbers
    )
    return replace(restored, mismatch=mismatch)
