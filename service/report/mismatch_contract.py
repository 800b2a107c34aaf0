"""What S and J leave out, as plain JSON types: the same fields in ``valves.json`` and ``explain``.

Errors in percent of span, fits, S and J in percent. NaN and infinities become null.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import (
    Effect,
    HeldOutFit,
    HotPlace,
    Mismatch,
    RecordEffect,
    Stiction,
)
from stemwatch.service.report.words import finite, printable

HELD_OUT = (
    "rmse_naive",
    "rmse_extended",
    "rmse_ceiling",
    "noise_floor",
    "fit_naive",
    "fit_extended",
    "gain_low",
    "gain_high",
)
NO_NUMBER = "the fit gave no finite number"


def mismatch_object(mismatch: Mismatch, *, stands: bool | None = None) -> dict[str, Any]:
    """``mismatch`` as in docs/json.md; the effects keep their order, strongest first.

    ``stands`` says whether they stand among all valves of the run; ``None`` where none was named.
    """
    return {
        "verdict": mismatch.finding.value,
        "sentence": printable(mismatch.sentence),
        "effects": [_effect(one) for one in mismatch.effects],
        "record_effects": [_record_effect(one) for one in mismatch.record_effects],
        "not_testable": [
            {"slug": printable(one.slug), "reason": printable(one.reason)}
            for one in mismatch.not_testable
        ],
        "stiction": {
            "naive": _stiction(mismatch.naive),
            "restated": _stiction(mismatch.restated),
        },
        "heldout": _heldout(mismatch.heldout),
        "hot_places": {
            "before": _hot(mismatch.before.hot),
            "after": _hot(mismatch.after.hot),
        },
        "p_value": finite(mismatch.p_value),
        "stands": stands,
        "seconds": finite(mismatch.seconds),
    }


def estimate_object(estimate: Estimate) -> dict[str, Any]:
    """An estimate: ``value``, ``low``, ``high``, ``unit``, and ``reason`` where there is none."""
    value, reason = finite(estimate.value), estimate.reason
    if value is None and reason is None:
        reason = NO_NUMBER
    return {
        "value": value,
        "low": finite(estimate.low),
        "high": finite(estimate.high),
        "unit": printable(estimate.unit),
        "reason": None if reason is None else printable(reason),
    }


def _effect(effect: Effect) -> dict[str, Any]:
    evidence = effect.evidence
    return {
        "slug": printable(effect.slug),
        "class": [printable(slug) for slug in effect.members],
        "sentence": printable(effect.sentence),
        "where": printable(effect.where),
        "check": printable(effect.check),
        "decide": printable(effect.decide),
        "parameters": {
            printable(name): estimate_object(one) for name, one in effect.parameters.items()
        },
        "evidence": {
            "mean": finite(evidence.mean),
            "t": finite(evidence.t),
            "share": finite(evidence.share),
            "strength": finite(evidence.strength),
            "note": printable(evidence.note),
        },
    }


def _record_effect(effect: RecordEffect) -> dict[str, Any]:
    return {
        "slug": printable(effect.slug),
        "sentence": printable(effect.sentence),
        "parameters": {printable(name): finite(one) for name, one in effect.parameters.items()},
    }


def _stiction(stiction: Stiction) -> dict[str, Any]:
    return {"S": estimate_object(stiction.S), "J": estimate_object(stiction.J)}


def _heldout(heldout: HeldOutFit) -> dict[str, float | None]:
    return {name: finite(getattr(heldout, name)) for name in HELD_OUT}


def _hot(places: Sequence[HotPlace]) -> list[dict[str, Any]]:
    return [
        {
            "facet": printable(one.facet),
            "label": printable(one.label),
            "share": finite(one.share),
            "z": finite(one.z),
            "sentence": printable(one.sentence),
        }
        for one in places
    ]
