"""A ``Screening`` as columns of its row, and rows as the values of ``records``."""

from __future__ import annotations

import hashlib
import math
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

from stemwatch.models.estimate import Estimate
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import PERCENT, Provenance
from stemwatch.models.screening_result import Residual, Screening
from stemwatch.models.signals.position_histograms import PositionHistograms
from stemwatch.models.verdict import NoVerdict, Shape, Verdict
from stemwatch.models.without_position.suspicion import Suspicion, WithoutPosition
from stemwatch.service.store.screenings.evidence_json import evidence_json
from stemwatch.service.store.screenings.mismatch_json import (
    mismatch_json,
    mismatch_of,
    question_json,
    question_of,
)
from stemwatch.service.store.screenings.named_effects import confirmed_of, remark_of
from stemwatch.service.store.screenings.records import (
    RunState,
    StoredRun,
    StoredScreening,
    StoredValve,
)
from stemwatch.service.store.screenings.tables import RunRow, ScreeningRow, ValveRow
from stemwatch.service.store.storable import clean_text, finite, from_row


def window_key(screening: Screening) -> str:
    """The key of a screening's window: ``start|end`` in UTC where known, else the digest of the
    source, else the digest of its name. The same key replaces the stored screening."""
    start, end = screening.window
    if start is not None and end is not None:
        return f"{start.astimezone(UTC).isoformat()}|{end.astimezone(UTC).isoformat()}"
    provenance = screening.provenance
    if provenance.digest:
        return f"source:{provenance.digest}"
    name = clean_text(provenance.source).encode()
    return f"name:{hashlib.sha256(name).hexdigest()}"


def screening_columns(screening: Screening, now: datetime) -> dict[str, Any]:
    """The columns of ``screenings`` that follow from the screening itself."""
    start, end = screening.window
    return {
        "valve": screening.valve,
        "window_key": window_key(screening),
        "window_start": start,
        "window_end": end,
        "at": end or now,
        "verdict": Verdict(screening.verdict).value,
        "no_verdict": None if screening.no_verdict is None else screening.no_verdict.value,
        "reason": screening.reason,
        "advice": screening.advice,
        "shape": None if screening.shape is None else Shape(screening.shape).value,
        "severity": finite(screening.severity) or 0.0,
        "confidence": finite(screening.confidence),
        "grade": screening.quality.grade,
        "grade_reasons": list(screening.quality.reasons),
        **_estimate_columns("s", screening.S),
        **_estimate_columns("j", screening.J),
        "residuals": {name: _residual_json(r) for name, r in screening.residuals.items()},
        "still_seen": list(screening.still_seen),
        "baseline_note": screening.baseline_note,
        "source": screening.provenance.source,
        "source_digest": screening.provenance.digest,
        "layout": screening.provenance.layout,
        "decisions": list(screening.provenance.decisions),
        "position_question": screening.provenance.position_question,
        "seconds": finite(screening.seconds) or 0.0,
        "without_position": _without_position_json(screening.without_position),
        "histograms": None if screening.histograms is None else asdict(screening.histograms),
        **_mismatch_columns(screening),
    }


def indicator_columns(
    screening: Screening, screening_id: int, at: datetime
) -> list[dict[str, Any]]:
    """The rows of ``indicators`` of one screening."""
    return [
        {
            "screening_id": screening_id,
            "name": name,
            "valve": screening.valve,
            "at": at,
            "value": finite(indicator.value),
            "low": finite(indicator.low),
            "high": finite(indicator.high),
            "unit": indicator.unit,
        }
        for name, indicator in screening.indicators.items()
    ]


def stored_screening(row: ScreeningRow, *, with_mismatch: bool = True) -> StoredScreening:
    """The row as ``StoredScreening``; ``with_mismatch=False`` saves time for thousands of rows."""
    return from_row(
        StoredScreening,
        row,
        window=(row.window_start, row.window_end),
        verdict=Verdict(row.verdict),
        no_verdict=no_verdict_of(row),
        shape=None if row.shape is None else Shape(row.shape),
        S=_estimate(row.s_percent, row.s_low_percent, row.s_high_percent, row.s_reason),
        J=_estimate(row.j_percent, row.j_low_percent, row.j_high_percent, row.j_reason),
        residuals={name: _residual(stored) for name, stored in row.residuals.items()},
        quality=DataQuality(grade=row.grade, reasons=tuple(row.grade_reasons)),
        still_seen=tuple(row.still_seen),
        provenance=_provenance(row),
        without_position=without_position_of(row.without_position),
        histograms=_histograms(row.histograms),
        mismatch=mismatch_of(row.mismatch) if with_mismatch else None,
        open_question=question_of(row.open_question),
        held_back=remark_of(row.mismatch) if with_mismatch else "",
        confirmed=confirmed_of(row.evidence),
    )


def no_verdict_of(row: Any) -> NoVerdict | None:
    """Why a row with these columns is undetermined; ``None`` where it has a verdict."""
    undetermined = row.verdict == Verdict.UNDETERMINED.value
    return NoVerdict.of(row.no_verdict) if undetermined else None


def _histograms(stored: Any) -> PositionHistograms | None:
    if not isinstance(stored, dict):
        return None
    lists = {name: tuple(kept) for name, kept in stored.items() if isinstance(kept, list)}
    return PositionHistograms(**stored | lists)


def stored_valve(row: ValveRow) -> StoredValve:
    """The row as ``StoredValve``."""
    return StoredValve.of(row)


def _mismatch_columns(screening: Screening) -> dict[str, Any]:
    mismatch = screening.mismatch
    return {
        "mismatch_finding": None if mismatch is None else mismatch.finding.value,
        "mismatch_slugs": None
        if mismatch is None
        else [effect.slug for effect in mismatch.effects],
        "mismatch": mismatch_json(mismatch),
        "open_question": question_json(screening.open_question),
        "evidence": evidence_json(screening),
    }


def _provenance(row: ScreeningRow) -> Provenance:
    return Provenance(
        source=row.source,
        digest=row.source_digest,
        layout=row.layout,
        decisions=tuple(row.decisions),
        position_question=row.position_question,
    )


def _without_position_json(suspicion: WithoutPosition | None) -> dict[str, Any] | None:
    if suspicion is None:
        return None
    S = suspicion.apparent_S
    return {
        "verdict": suspicion.verdict.value,
        "reason": suspicion.reason,
        "advice": suspicion.advice,
        "score": finite(suspicion.score),
        "S": [finite(S.value), finite(S.low), finite(S.high)],
        "unit": S.unit,
        "S_reason": S.reason,
        "shows_from": finite(suspicion.shows_from),
        "rivals": list(suspicion.rivals),
        "recordings": suspicion.recordings,
        "alone": _without_position_json(suspicion.alone),
    }


def without_position_of(stored: dict[str, Any] | None) -> WithoutPosition | None:
    """What OP and PV alone say, as it is stored."""
    if stored is None:
        return None
    value, low, high = stored["S"]
    return WithoutPosition(
        verdict=Suspicion(stored["verdict"]),
        reason=stored["reason"],
        advice=stored["advice"],
        score=stored["score"],
        apparent_S=Estimate(
            value=value, low=low, high=high, unit=stored["unit"], reason=stored["S_reason"]
        ),
        shows_from=stored["shows_from"],
        rivals=tuple(stored["rivals"]),
        recordings=stored.get("recordings", 1),  # an older version counted one, the newest
        alone=without_position_of(stored.get("alone")),
    )


def _estimate_columns(name: str, estimate: Estimate) -> dict[str, float | str | None]:
    value = finite(estimate.value)
    reason, not_finite = estimate.reason, estimate.value is not None and value is None
    if not_finite:
        reason = f"the estimate was not a finite number ({estimate.value})"
    return {
        f"{name}_percent": value,
        f"{name}_low_percent": None if not_finite else finite(estimate.low),
        f"{name}_high_percent": None if not_finite else finite(estimate.high),
        f"{name}_reason": reason,
    }


def _estimate(
    value: float | None, low: float | None, high: float | None, reason: str | None
) -> Estimate:
    return Estimate(value=value, low=low, high=high, unit=PERCENT, reason=reason)


def _residual_json(residual: Residual | None) -> dict[str, float | None] | None:
    if residual is None:
        return None
    return {
        "rmse": residual.rmse,
        "normalised": residual.normalised,
        "one_step": residual.one_step,
    }


def _residual(stored: dict[str, float | None] | None) -> Residual | None:
    if stored is None:
        return None
    return Residual(
        rmse=_number(stored["rmse"]),
        normalised=_number(stored["normalised"]),
        one_step=stored["one_step"],
    )


def _number(stored: float | None) -> float:
    return math.nan if stored is None else stored


def stored_run(run: RunRow) -> StoredRun:
    """The row as ``StoredRun``."""
    return from_row(
        StoredRun,
        run,
        counts={Verdict(verdict): count for verdict, count in run.counts.items()},
        state=RunState(run.state),
        window=(run.window_start, run.window_stop),
        asked=tuple(run.asked or ()),
    )
