"""The evidence of one screening as JSON and back: about 1 kB, while its whole mismatch takes 30
kB."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.evidence_over_windows import WindowEvidence
from stemwatch.models.mismatch.findings import EffectScore
from stemwatch.models.recording import PERCENT
from stemwatch.models.screening_result import Screening
from stemwatch.service.store.storable import finite

_DIGITS = 4


def evidence_json(screening: Screening) -> dict[str, Any] | None:
    """``named``, ``sizes`` (slug, name, value and unit of each), ``scores`` (mean, t and strength
    by slug), S and J (value, low, high), the p value, and what ``begins_anew``; ``None`` where no
    effect was looked for."""
    mismatch, at = screening.mismatch, screening.window[1] or datetime.min
    if mismatch is None:
        return None
    evidence = WindowEvidence.of(mismatch, at, begins_anew=screening.changed)
    return {
        "named": [list(members) for members in evidence.named],
        "sizes": [
            [*place, value, size.unit]
            for place, size in evidence.sizes.items()
            if (value := finite(size.value)) is not None
        ],
        "scores": {
            score.slug: [_short(score.mean), _short(score.t), _short(score.strength)]
            for score in evidence.scores
        },
        "S": _triple(evidence.S),
        "J": _triple(evidence.J),
        "p_value": finite(evidence.p_value),
        "begins_anew": evidence.begins_anew,
    }


def evidence_of(stored: dict[str, Any], start: datetime | None, at: datetime) -> WindowEvidence:
    """The evidence of a window from its JSON."""
    return WindowEvidence(
        at=at,
        start=start,
        named=tuple(tuple(members) for members in stored.get("named", ())),
        sizes={
            (slug, name): Estimate(value=value, unit=unit)
            for slug, name, value, unit in stored.get("sizes", ())
        },
        scores=tuple(
            EffectScore(slug=slug, mean=mean or 0.0, t=t or 0.0, strength=strength or 0.0)
            for slug, (mean, t, strength) in stored.get("scores", {}).items()
        ),
        S=_estimate(stored.get("S")),
        J=_estimate(stored.get("J")),
        p_value=stored.get("p_value"),
        begins_anew=stored.get("begins_anew", ""),
    )


def _short(value: float) -> float | None:
    number = finite(value)
    return None if number is None else round(number, _DIGITS)


def _triple(estimate: Estimate | None) -> list[float | None] | None:
    if estimate is None or finite(estimate.value) is None:
        return None
    return [finite(estimate.value), finite(estimate.low), finite(estimate.high)]


def _estimate(triple: list[float | None] | None) -> Estimate | None:
    if triple is None:
        return None
    value, low, high = triple
    return Estimate(value=value, low=low, high=high, unit=PERCENT)
