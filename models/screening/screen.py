"""``screen``: the whole method on one page, from recordings to verdicts.

    recording -> quality -> stick-slip fit -> NARX fit -> mismatch -> baseline -> verdict

Each valve is independent: one that fails is a result with a reason, and the others go on. The
networks of all valves in a call train together. A long recording is fitted on the stretch with the
most movement (``preparation.fit_window``); numbers that need no fit are taken from all of it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from stemwatch.models.decision import residual
from stemwatch.models.decision.decide import decide
from stemwatch.models.decision.decision import Decision
from stemwatch.models.decision.no_verdict import undetermined
from stemwatch.models.estimate import Estimate
from stemwatch.models.health_indicators import indicators
from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.acceptance.rivals import on_site
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.mismatch.measurement.record_effects import late_effect, scan_sentence
from stemwatch.models.narx.example import NarxExample, NarxFit, NarxSettings
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.preparation.fit_window import window_sentence
from stemwatch.models.preparation.own_clock import off_own_clock
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.record_checks.record_facts import facts_without_verdict
from stemwatch.models.record_checks.validity_checks import OP_AT_REST
from stemwatch.models.recording import PERCENT, Provenance, Recording
from stemwatch.models.screening.evidence import evidence_of
from stemwatch.models.screening.fitted_recording import (
    AssessedRecording,
    FittedRecording,
    fit_recording,
)
from stemwatch.models.screening.left_out import as_shown, explained
from stemwatch.models.screening.networks import network_start, train_each
from stemwatch.models.screening.published_stiction import published_stiction
from stemwatch.models.screening.repair import with_repair
from stemwatch.models.screening_result import Indicator, Residual, Screening, Traces
from stemwatch.models.signals.position_histograms import position_histograms
from stemwatch.models.stickslip.op_within_steps import WITHIN_STEPS
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.stickslip.stroke_curve import KnownCurve, in_travel
from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.models.without_position.suspicion import suspect, too_little_moved, trained_judge


@dataclass(frozen=True, kw_only=True)
class Case:
    """One recording to screen, with the valve's baseline network where there is one.

    ``known_curve`` is what is known of how OP strokes the valve, from a person or an earlier
    window; PV is on target within ``target_band`` of SP, in its unit.
    """

    recording: Recording
    baseline: NarxNetwork | None = None
    baseline_note: str = "No earlier baseline to compare with."
    known_curve: KnownCurve | None = None
    target_band: float | None = None


@dataclass(frozen=True, kw_only=True)
class Options:
    """How to screen. ``narx`` and ``mismatch`` may be switched off to save time."""

    limits: Limits = field(default_factory=Limits)
    narx: bool = True
    mismatch: bool = True
    narx_settings: NarxSettings = field(default_factory=NarxSettings)


DEFAULTS = Options()


def screen(cases: Sequence[Case], options: Options = DEFAULTS) -> list[Screening]:
    """One ``Screening`` for each case, in order. Never raises for what a recording holds."""
    fitted = [_fit_or_reason(case, options.limits) for case in cases]
    networks = _train(fitted, options)
    return [
        valve
        if isinstance(valve, Screening)
        else _conclude_or_reason(case, valve, network, options)
        for case, valve, network in zip(cases, fitted, networks, strict=True)
    ]


def failed(valve: str, reason: str, advice: str, provenance: Provenance) -> Screening:
    """The screening of a valve whose recording could not even be read."""
    unknown = Estimate.unknown(reason, unit=PERCENT)
    return Screening(
        valve=valve,
        verdict=Verdict.UNDETERMINED,
        reason=f"Cannot tell: {reason}",
        advice=advice,
        shape=None,
        severity=15.0,
        confidence=None,
        S=unknown,
        J=unknown,
        residuals={"stiction": None, "narx": None, "baseline": None},
        quality=DataQuality(grade="D", reasons=(reason,)),
        indicators={},
        no_verdict=NoVerdict.NOT_READ,
        provenance=provenance,
    )


def _crashed(recording: Recording, error: Exception) -> Screening:
    reason = f"the fit broke down on this recording ({type(error).__name__}: {error})."
    advice = "Report this with the recording; the other valves are not affected."
    return replace(
        failed(recording.valve, reason, advice, recording.provenance),
        no_verdict=NoVerdict.BROKE_DOWN,
        recording=recording,
    )


def _fit_or_reason(case: Case, limits: Limits) -> AssessedRecording | Screening:
    try:
        return fit_recording(case.recording, case.known_curve, limits)
    except Exception as error:  # one valve must not end a plant's run
        return _crashed(case.recording, error)


def _train(
    fitted: Sequence[AssessedRecording | Screening], options: Options
) -> list[NarxFit | None]:
    """A network for each recording that has a fit, all trained together."""
    ready = [
        (index, valve) for index, valve in enumerate(fitted) if isinstance(valve, FittedRecording)
    ]
    trained: list[NarxFit | None] = [None] * len(fitted)
    if not ready or not options.narx:
        return trained
    examples = [
        NarxExample.of(valve.masked, valve.fit.first_heldout, network_start(valve.fit, valve.curve))
        for _, valve in ready
    ]
    for (index, valve), fit in zip(ready, train_each(examples, options.narx_settings), strict=True):
        trained[index] = fit.in_seconds(valve.recording.unit_s)
    return trained


def _conclude_or_reason(
    case: Case, valve: AssessedRecording, network: NarxFit | None, options: Options
) -> Screening:
    try:
        return _conclude(case, valve, network, options)
    except Exception as error:  # one valve must not end a plant's run
        return _crashed(valve.whole, error)


def _conclude(
    case: Case, valve: AssessedRecording, network: NarxFit | None, options: Options
) -> Screening:
    started = time.perf_counter()
    if isinstance(valve, FittedRecording):
        look_for_curve = case.known_curve is None
        mismatch = (
            explained(valve, network, look_for_curve=look_for_curve) if options.mismatch else None
        )
        screening = _with_verdict(case, valve, network, mismatch, options.limits)
    else:
        screening = _without_verdict(case, valve)
    screening = with_repair(screening, valve.whole, case.target_band)
    screening = _with_suspicion(screening, valve)
    seconds = valve.seconds + time.perf_counter() - started
    return replace(screening, seconds=seconds + (network.seconds if network else 0.0))


def _with_verdict(
    case: Case,
    fitted: FittedRecording,
    network: NarxFit | None,
    mismatch: Mismatch | None,
    limits: Limits,
) -> Screening:
    S, J, S_draws = published_stiction(fitted, mismatch)
    # A network is stored in seconds.
    baseline = residual.of_baseline(case.baseline, off_own_clock(fitted.masked))
    narx = residual.of_narx(network)
    evidence = evidence_of(fitted, (S, J, S_draws), narx, baseline, mismatch)
    judgement = decide(evidence, limits)
    if not judgement.numbers_hold:
        S = J = Estimate.unknown(judgement.reason, unit=PERCENT)
    sticks = judgement.verdict is Verdict.STICKY
    if mismatch is not None:
        mismatch = as_shown(
            mismatch,
            fitted,
            S,
            J,
            may_be_S=evidence.may_stick_unseen(limits) and not sticks,
            hidden=evidence.is_hidden(limits),
        )
    residuals = {
        "stiction": residual.of_stiction(fitted.fit, resynced=False),
        "narx": narx,
        "baseline": baseline.residual,
    }
    numbers = [
        *indicators.of_recording(fitted.assessment.recording),
        *_movement(fitted),
        *indicators.of_friction(fitted.fit, S, J, fitted.op_per_travel),
        *indicators.of_residuals(residuals, baseline.ratio),
    ]
    screening = _screening(case, fitted, judgement, (S, J), residuals, numbers)
    return replace(
        screening,
        mismatch=mismatch,
        stroke_curve=fitted.curve,
        baseline_note=" ".join(filter(None, (case.baseline_note, baseline.reason))),
        network=network.network if network is not None else None,
        traces=_traces(fitted, network),
    )


def _without_verdict(case: Case, assessed: AssessedRecording) -> Screening:
    obstacles = assessed.assessment.obstacles
    unknown = Estimate.unknown(obstacles[0].reason, unit=PERCENT)
    residuals: dict[str, Residual | None] = {"stiction": None, "narx": None, "baseline": None}
    recording = assessed.assessment.recording
    screening = _screening(
        case,
        assessed,
        undetermined(obstacles),
        (unknown, unknown),
        residuals,
        indicators.of_recording(recording),
    )
    return replace(screening, open_question=on_site(None, recording, assessed.curve))


def _screening(
    case: Case,
    valve: AssessedRecording,
    judgement: Decision,
    stiction: tuple[Estimate, Estimate],
    residuals: dict[str, Residual | None],
    numbers: list[Indicator],
) -> Screening:
    recording = _remembering(valve)
    undecided = judgement.verdict is Verdict.UNDETERMINED
    S, J = stiction
    return Screening(
        valve=recording.valve,
        verdict=judgement.verdict,
        reason=" ".join(filter(None, (judgement.reason, valve.curve_changed))),
        advice=judgement.advice,
        shape=judgement.shape,
        severity=judgement.severity,
        confidence=judgement.confidence,
        no_verdict=judgement.no_verdict,
        S=S,
        J=J,
        residuals=residuals,
        quality=valve.assessment.quality,
        indicators={
            indicator.name: indicator
            for indicator in indicators.in_seconds(numbers, valve.recording)
        },
        still_seen=facts_without_verdict(recording) if undecided else (),
        baseline_note=case.baseline_note,
        recording=recording,
        provenance=recording.provenance,
        histograms=position_histograms(valve.whole),
        changed=valve.curve_changed,
    )


def _remembering(valve: AssessedRecording) -> Recording:
    """The recording with sentences in its provenance: what was fitted, and through which curve."""
    recording = valve.whole
    sentences = [window_sentence(valve.stretch, recording)] if valve.stretch is not None else []
    if valve.late_s:
        sentences += [late_effect(valve.late_s, valve.recording.unit_s).sentence]
    sentences += [sentence for sentence in [scan_sentence(valve.recording)] if sentence]
    sentences += [WITHIN_STEPS] if valve.within_steps else []
    sentences += [valve.curve.sentence()] if valve.curve is not None else []
    if isinstance(valve, FittedRecording) and valve.archive is not None:
        sentences.append(valve.archive.sentence(valve.missed))
    if not sentences:
        return recording
    decisions = (*recording.provenance.decisions, *sentences)
    return replace(recording, provenance=replace(recording.provenance, decisions=decisions))


def _movement(fitted: FittedRecording) -> list[Indicator]:
    """How the stem moved in the whole recording, whatever part of it was fitted."""
    fit = fitted.fit
    if fitted.stretch is None:
        return indicators.of_movement(fit.evaluator.problem, fit.events)
    whole_problem = make_problem(in_travel(fitted.assessment.recording, fitted.curve))
    evaluator = replace(fit.evaluator, problem=whole_problem)
    return indicators.of_movement(whole_problem, replace(fit, evaluator=evaluator).events)


def _traces(fitted: FittedRecording, network: NarxFit | None) -> Traces:
    """The free runs on the clock of the whole recording."""
    traces = Traces(
        stiction=fitted.fit.heldout(),
        narx=network.simulated if network is not None else None,
        heldout_from=fitted.fit.first_heldout,
    )
    if fitted.stretch is None:
        return traces
    return traces.within(fitted.stretch.first, len(fitted.whole))


def _with_suspicion(screening: Screening, valve: AssessedRecording) -> Screening:
    """``screening`` with the evidence of OP and PV alone. Without a position it is the only
    evidence; with one it is a cross-check that changes no verdict.
    """
    suspicion = suspect(valve.whole, trained_judge())
    for obstacle in valve.assessment.obstacles[:1]:  # the first one is the reason that is given
        if obstacle.slug in OP_AT_REST:
            suspicion = too_little_moved(suspicion, obstacle.reason, obstacle.remedy)
    screening = replace(screening, without_position=suspicion)
    return screening.with_indicators(indicators.of_suspicion(suspicion))
