"""The JSON contract, version 2: one object per valve, described by ``contract.schema.json``; its
``mismatch`` (what S and J leave out) is the same in ``valves.json`` and ``stemwatch explain``.

Within a version fields are only ever added. Errors in percent of span, fits, S and J in percent.
NaN and infinities never appear: they become null.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, tzinfo
from typing import Any

from stemwatch.models.estimate import Estimate
from stemwatch.models.health_indicators.response_figures import (
    ResponseFigures,
    StepFigures,
    response_figures,
)
from stemwatch.models.history.evidence_over_windows import LastingFinding
from stemwatch.models.history.trend_over_weeks import TrendOverWeeks
from stemwatch.models.mismatch.findings import (
    Effect,
    Gain,
    HeldOutFit,
    HotPlace,
    Mismatch,
    RecordEffect,
    Stiction,
    TriedEffect,
)
from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.models.screening_result import Indicator, Residual, Screening
from stemwatch.models.signals.position_histograms import EDGES, STROKE_EDGES, PositionHistograms
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.models.without_position.suspicion import WithoutPosition
from stemwatch.service.plant_path import LEVELS, NO_PATH, PlantPath
from stemwatch.service.presenter.cost_of_sticking import CostOfSticking, cost_of_sticking
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks
from stemwatch.service.presenter.finding import PresentedFinding, present, present_effect
from stemwatch.service.presenter.urgency import priority_of
from stemwatch.service.presenter.wording import finite, printable
from stemwatch.service.report.report_context import software_name

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
NO_TREND = "S does not rise over weeks"
NO_NUMBER = "the fit gave no finite number"


def mismatch_object(mismatch: Mismatch, *, stands: bool | None = None) -> dict[str, Any]:
    """``mismatch`` as in docs/json.md; the effects keep their order, that of work.

    ``stands`` says whether they stand among all valves of the run; ``None`` where none was named.
    """
    return {
        "verdict": mismatch.finding.value,
        "sentence": printable(mismatch.sentence),
        "effects": [_effect(effect) for effect in mismatch.effects],
        "record_effects": [
            _record_effect(record_effect) for record_effect in mismatch.record_effects
        ],
        "not_testable": [
            {"slug": printable(untestable.slug), "reason": printable(untestable.reason)}
            for untestable in mismatch.not_testable
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
        "tried": [_tried_effect(tried_effect) for tried_effect in mismatch.tried],
        "together": _gain(mismatch.together),
        "p_value": finite(mismatch.p_value),
        "stands": stands,
        "stroke_curve": _stroke_curve(mismatch.stroke_curve),
        "seconds": finite(mismatch.seconds),
    }


def _stroke_curve(curve: StrokeCurve | None) -> dict[str, Any] | None:
    if curve is None:
        return None
    return {
        "op_percent": list(curve.op),
        "travel_percent": list(curve.travel),
        "slope": curve.slope,
        "slope_known": curve.slope_known,
        "sentence": printable(curve.sentence()),
        "proposal": printable(curve.proposal()),
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


def without_position_object(suspicion: WithoutPosition | None) -> dict[str, Any] | None:
    """What OP and PV alone say of the valve; ``None`` where they were not asked."""
    if suspicion is None:
        return None
    return {
        "verdict": suspicion.verdict.value,
        "score": finite(suspicion.score),
        "apparent_S": estimate_object(suspicion.apparent_S),
        "shows_from": finite(suspicion.shows_from),
        "rivals": [printable(rival) for rival in suspicion.rivals],
        "reason": printable(suspicion.reason),
        "advice": printable(suspicion.advice),
        "recordings": suspicion.recordings,
        "alone": None
        if suspicion.alone is None
        else {
            "verdict": suspicion.alone.verdict.value,
            "score": finite(suspicion.alone.score),
            "reason": printable(suspicion.alone.reason),
        },
    }


def _effect(effect: Effect) -> dict[str, Any]:
    evidence, presented = effect.evidence, present_effect(effect)
    return {
        "slug": printable(effect.slug),
        "class": [printable(slug) for slug in effect.members],
        "sentence": printable(presented.sentence),
        "where": printable(presented.where),
        "check": printable(presented.check),
        "decide": printable(effect.decide),
        "parameters": {
            printable(name): estimate_object(parameter)
            for name, parameter in effect.parameters.items()
        },
        "evidence": {
            "mean": finite(evidence.mean),
            "t": finite(evidence.t),
            "share": finite(evidence.share),
            "strength": finite(evidence.strength),
            "note": printable(evidence.note),
        },
        "test": None
        if presented.test is None
        else {
            "do": printable(presented.test.do),
            "fails": printable(presented.test.fails),
            "passes": printable(presented.test.passes),
        },
        "inherent": effect.inherent,
    }


def _gain(gain: Gain | None) -> dict[str, float | None] | None:
    return None if gain is None else {"mean": finite(gain.mean), "t": finite(gain.t)}


def _tried_effect(tried_effect: TriedEffect) -> dict[str, Any]:
    return {
        "slug": printable(tried_effect.slug),
        "alone": _gain(tried_effect.alone),
        "beside": _gain(tried_effect.beside),
        "outcome": tried_effect.outcome.value,
    }


def _record_effect(effect: RecordEffect) -> dict[str, Any]:
    return {
        "slug": printable(effect.slug),
        "sentence": printable(effect.sentence),
        "parameters": {
            printable(name): finite(parameter) for name, parameter in effect.parameters.items()
        },
    }


def _stiction(stiction: Stiction) -> dict[str, Any]:
    return {"S": estimate_object(stiction.S), "J": estimate_object(stiction.J)}


def _heldout(heldout: HeldOutFit) -> dict[str, float | bool | None]:
    numbers = {name: finite(getattr(heldout, name)) for name in HELD_OUT}
    measured = numbers["rmse_naive"] is not None
    return {
        **numbers,
        "slip_by_slip": heldout.slip_by_slip if measured else None,
        "alternate_blocks": heldout.alternate_blocks if measured else None,
    }


def _hot(places: Sequence[HotPlace]) -> list[dict[str, Any]]:
    return [
        {
            "facet": printable(cell.facet),
            "label": printable(cell.label),
            "share": finite(cell.share),
            "z": finite(cell.z),
            "sentence": printable(cell.sentence),
        }
        for cell in places
    ]


CONTRACT_VERSION = 2
MODELS = ("stiction", "narx", "baseline")


def to_contract(
    screening: Screening,
    *,
    stands: bool | None = None,
    confirmed: tuple[str, ...] | None = None,
    by_window: EvidenceOfWeeks | None = None,
    zone: tzinfo = UTC,
    groups: Sequence[OscillationGroup] = (),
    cost: CostOfSticking | None = None,
    path: PlantPath = NO_PATH,
    criticality: str = "",
    weeks: TrendOverWeeks | None = None,
    finding: PresentedFinding | None = None,
) -> dict[str, Any]:
    """One screening as plain JSON types; S, J and rmse in percent of span, times in UTC.

    ``stands`` says whether its effects stand among all valves of the run, ``by_window`` what the
    windows of the last weeks say together, ``confirmed`` what of it stands, ``groups`` which loops
    oscillate together, ``cost`` what the sticking costs with the plant's prices, ``path`` where in
    the plant the valve is, ``criticality`` what the plant states of it, ``weeks`` how its S goes.
    ``finding`` has the words of all this where the caller has them already. Days in sentences are
    those of ``zone``, as in a report.
    """
    mismatch = screening.mismatch
    presented = finding or present(screening, stands=stands, confirmed=confirmed, groups=groups)
    cost = cost or cost_of_sticking(screening.indicators, None)
    urgency = priority_of(presented.decision, criticality)
    start, end = screening.window
    return {
        "version": CONTRACT_VERSION,
        "valve": printable(screening.valve),
        "path": {level: printable(getattr(path, level)) or None for level in LEVELS},
        "recording": printable(screening.provenance.source),
        "window": {"start": _instant(start), "end": _instant(end)},
        "verdict": presented.decision.verdict.value,
        "reason": printable(presented.reason),
        "advice": printable(presented.next_step),
        "shape": None if screening.shape is None else screening.shape.value,
        "severity": finite(presented.decision.severity),
        "priority": None if urgency is None else urgency.code,
        "confidence": finite(presented.decision.confidence),
        "ne107": presented.decision.ne107,
        "stem_verdict": screening.verdict.value,
        "stem_confidence": finite(screening.confidence),
        "stiction": {"S": estimate_object(screening.S), "J": estimate_object(screening.J)},
        "response": _response(screening),
        "residuals": {model: _residual(model, screening.residuals.get(model)) for model in MODELS},
        "quality": {
            "grade": printable(screening.quality.grade),
            "reasons": [printable(reason) for reason in screening.quality.reasons],
        },
        "indicators": {
            printable(name): _indicator(indicator)
            for name, indicator in screening.indicators.items()
        },
        "mismatch": None if mismatch is None else mismatch_object(mismatch, stands=stands),
        "without_position": without_position_object(screening.without_position),
        "over_weeks": []
        if by_window is None
        else [_lasting(finding, by_window, zone) for finding in by_window.findings],
        "histograms": _histograms(screening.histograms),
        "trend": _trend(weeks),
        "cost_of_sticking": _cost(cost),
        "oscillates_with": _oscillates_with(groups, screening.valve),
        "still_seen": [printable(sentence) for sentence in screening.still_seen],
        "baseline": printable(screening.baseline_note),
        "provenance": _provenance(screening),
        "seconds": finite(screening.seconds),
    }


def _histograms(histograms: PositionHistograms | None) -> dict[str, Any] | None:
    if histograms is None:
        return None
    return {
        "edges_percent": list(EDGES.tolist()),
        "time_percent": list(histograms.time),
        "travel_percent": list(histograms.travel),
        "reversals": list(histograms.reversals),
        "stroke_edges_percent": list(STROKE_EDGES),
        "strokes": list(histograms.strokes),
        "hours": finite(histograms.hours),
    }


def _trend(weeks: TrendOverWeeks | None) -> dict[str, Any] | None:
    """The rate of S over weeks, and when it reaches the limit of sticky."""
    if weeks is None:
        return None
    no_trend = Estimate.unknown(NO_TREND, "weeks")
    until = no_trend if weeks.forecast is None else weeks.forecast.until
    return {
        "S_per_month": estimate_object(weeks.rate),
        "J_per_month": None if weeks.J is None else estimate_object(weeks.J.rate),
        "days": finite(weeks.days),
        "is_change": weeks.is_change,
        "weeks_until_sticky": estimate_object(until),
        "sentence": printable(weeks.words),
    }


def _cost(cost: CostOfSticking | None) -> dict[str, Any] | None:
    """What the sticking costs; money a month."""
    if cost is None:
        return None
    return {
        "variance_share_percent": estimate_object(cost.share),
        "money_per_month": estimate_object(cost.money),
        "sentence": printable(cost.sentence),
    }


def _oscillates_with(groups: Sequence[OscillationGroup], loop: str) -> list[dict[str, Any]]:
    """The groups of which a loop is a member, as plain types."""
    return [
        {
            "period_s": finite(group.period_s),
            "loops": [printable(member.loop) for member in group.members],
            "share": finite(next(member.share for member in group.members if member.loop == loop)),
            "source": printable(group.source) or None,
            "source_probability": finite(group.members[0].probability),
            "outside_probability": finite(group.outside),
            "since": _instant(group.since),
            "first_found": _instant(group.first_found or group.start),
            "windows": group.windows,
        }
        for group in groups
        if any(member.loop == loop for member in group.members)
    ]


def by_window_object(evidence: EvidenceOfWeeks) -> dict[str, Any]:
    """What the windows of one recording say together: each window, in seconds from the
    recording's beginning, what is followed, S and J."""
    pooled, recording_began = evidence.pooled, evidence.recording_began
    assert recording_began is not None
    return {
        "windows": [
            {
                "begin_s": ((window.start or window.at) - recording_began).total_seconds(),
                "end_s": (window.at - recording_began).total_seconds(),
                "named": [list(map(printable, members)) for members in window.named],
            }
            for window in evidence.windows
        ],
        "findings": [
            {
                "slug": printable(finding.slug),
                "confirmed": finding.holds,
                "named": finding.named,
                "of": finding.of,
                "sentence": printable(sentence),
            }
            for finding, sentence in zip(evidence.findings, evidence.sentences(), strict=False)
        ],
        "S": None if pooled is None else estimate_object(pooled.S),
        "J": None if pooled is None else estimate_object(pooled.J),
    }


def _response(screening: Screening) -> dict[str, Any]:
    figures = response_figures(screening)
    return {
        "dead_band": estimate_object(figures.dead_band),
        "resolution": estimate_object(figures.resolution),
        "steps": [
            {
                "step_percent": step.step_percent,
                "way": step.way.value,
                "direction": _direction(step, figures),
                "moves": finite(step.moves),
                "travel_gain": estimate_object(step.travel_gain),
                "dead_time": estimate_object(step.dead_time),
                "t86": estimate_object(step.t86),
                "overshoot": estimate_object(step.overshoot),
            }
            for step in figures.distinct_steps
        ],
        "simulated": list(figures.simulated),
        "left_out": list(figures.left_out),
    }


def _direction(step: StepFigures, figures: ResponseFigures) -> str:
    if figures.both_ways_alike:
        return "either"
    return "rising" if step.rising else "falling"


def _lasting(finding: LastingFinding, evidence: EvidenceOfWeeks, zone: tzinfo) -> dict[str, Any]:
    return {
        "slug": printable(finding.slug),
        "state": finding.state.value,
        "sentence": printable(evidence.sentence_of(finding, zone)),
        "sizes_per_month": {
            printable(name): estimate_object(trend.rate)
            for name, trend in evidence.size_trends(finding).items()
        },
        "first_seen": _instant(finding.first_seen),
        "confirmed": _instant(finding.confirmed),
        "last_seen": _instant(finding.last_seen),
        "named": finding.named,
        "of": finding.of,
    }


def _instant(moment: datetime | None) -> str | None:
    return None if moment is None else moment.isoformat()


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
        "decisions": [printable(decision) for decision in provenance.remarks],
        "software": software_name(),
    }
