"""The JSON contract, version 1: one object per valve, described by ``contract.schema.json``.

Within a version fields are only ever added. NaN and infinities never appear: they become null.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from stemwatch.models.screening_result import Indicator, Residual, Screening
from stemwatch.service.report.context import software_name
from stemwatch.service.report.discoveries import discoveries
from stemwatch.service.report.mismatch_contract import estimate_object, mismatch_object
from stemwatch.service.report.words import finite, printable

CONTRACT_VERSION = 1
MODELS = ("stiction", "narx", "baseline")


def to_contracts(screenings: Sequence[Screening]) -> list[dict[str, Any]]:
    """All screenings of a run as plain JSON types, in their order.

    Whether a valve's effects stand depends on all the others.
    """
    standing = discoveries([one.mismatch for one in screenings]).standing
    return [
        to_contract(one, stands=stands) for one, stands in zip(screenings, standing, strict=True)
    ]


def to_contract(screening: Screening, *, stands: bool | None = None) -> dict[str, Any]:
    """One screening as plain JSON types; S, J and rmse in percent of span, times in UTC.

    ``stands`` says whether its effects stand among all valves of the run.
    """
    found = screening.mismatch
    start, end = screening.window
    return {
        "version": CONTRACT_VERSION,
        "valve": printable(screening.valve),
        "recording": printable(screening.provenance.source),
        "window": {"start": _instant(start), "end": _instant(end)},
        "verdict": screening.verdict.value,
        "reason": printable(screening.reason),
        "advice": printable(screening.advice),
        "shape": None if screening.shape is None else screening.shape.value,
        "severity": finite(screening.severity),
        "confidence": finite(screening.confidence),
        "stiction": {"S": estimate_object(screening.S), "J": estimate_object(screening.J)},
        "residuals": {model: _residual(model, screening.residuals.get(model)) for model in MODELS},
        "quality": {
            "grade": printable(screening.quality.grade),
            "reasons": [printable(reason) for reason in screening.quality.reasons],
        },
        "indicators": {
            printable(name): _indicator(indicator)
            for name, indicator in screening.indicators.items()
        },
        "mismatch": None if found is None else mismatch_object(found, stands=stands),
        "still_seen": [printable(sentence) for sentence in screening.still_seen],
        "baseline": printable(screening.baseline_note),
        "provenance": _provenance(screening),
        "seconds": finite(screening.seconds),
    }


def _instant(when: datetime | None) -> str | None:
    return None if when is None else when.isoformat()


def _residual(model: str, residual: Residual | None) -> dict[str, float | None] | None:
    if residual is None:
        return None
    numbers = {
        "rmse": finite(residual.rmse),
        "normalised": finite(residual.normalised),
        "fit": finite(residual.fit_percent),
    }
    if model == "narx":
        numbers["one_step"] = finite(residual.one_step)
    return numbers


def _indicator(indicator: Indicator) -> dict[str, Any]:
    return {
        "value": finite(indicator.value),
        "low": finite(indicator.low),
        "high": finite(indicator.high),
        "unit": printable(indicator.unit),
        "meaning": printable(indicator.meaning),
    }


def _provenance(screening: Screening) -> dict[str, Any]:
    provenance = screening.provenance
    return {
        "digest": printable(provenance.digest),
        "layout": printable(provenance.layout),
        "decisions": [printable(decision) for decision in provenance.decisions],
        "software": software_name(),
    }
