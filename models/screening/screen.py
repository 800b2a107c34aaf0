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

from stemwatch.models.closed_loop.fitted_loop import FittedValve, fit_loop
from stemwatch.models.closed_loop.what_if import REPAIRED, predict
from stemwatch.models.decision import residual
from stemwatch.models.decision.beside_friction import actuator_takes_s, beside_friction
from stemwatch.models.decision.decide import Decision, DecisionEvidence, decide, undetermined
from stemwatch.models.decision.shaken_loose import (
    LIKE_A_SHAKEN_BAND,
    RESTS,
    S_unseen,
    dead_bands_of,
    is_sure,
    may_be_shaken,
    without_slow_actuator,
)
from stemwatch.models.estimate import Estimate
from stemwatch.models.health_indicators import indicators
from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.acceptance.rivals import on_site
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding, Mismatch, Stiction
from stemwatch.models.mismatch.measurement.between_samples import Archive, as_sampled
from stemwatch.models.mismatch.measurement.record_effects import late_effect, scan_sentence
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.narx.example import NarxExample, NarxFit, NarxSettings
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.preparation.fit_window import (
    FitWindow,
    choose_fit_window,
    on_whole_clock,
    window_sentence,
)
from stemwatch.models.preparation.loop_pace import at_loop_pace
from stemwatch.models.preparation.own_clock import duration, off_own_clock, on_own_clock
from stemwatch.models.record_checks.data_quality import DataQuality, Obstacle
from stemwatch.models.record_checks.own_swing import OwnSwing, own_swing
from stemwatch.models.record_checks.pulsing_stem import find_pulses
from stemwatch.models.record_checks.quality import Assessment, assess, with_obstacles
from stemwatch.models.record_checks.record_facts import facts_without_verdict
from stemwatch.models.record_checks.validity_checks import OP_AT_REST
from stemwatch.models.recording import PERCENT, Floats, Provenance, Recording
from stemwatch.models.screening.networks import network_start, train_each
from stemwatch.models.screening.prepared_command import prepare_command
from stemwatch.models.screening_result import Indicator, Residual, Screening, Traces
from stemwatch.models.signals.dead_band import DeadBand
from stemwatch.models.signals.oscillation import signal_oscillation
from stemwatch.models.signals.position_histograms import position_histograms
from stemwatch.models.stickslip.change_of_stiction import ChangeOfStiction, change_of_stiction
from stemwatch.models.stickslip.events import SlipEvents
from stemwatch.models.stickslip.fit import S_and_J, StickSlipFit, fit_stickslip
from stemwatch.models.stickslip.interval import (
    StickSlipSample,
    bootstrap,
    interval,
    spread_of,
    way_in_a_sample,
)
from stemwatch.models.stickslip.op_within_steps import WITHIN_STEPS
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.stickslip.stored_range import in_percent, range_of_both, range_of_op
from stemwatch.models.stickslip.stroke_curve import KnownCurve, StrokeCurve, in_travel
from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.models.without_position.suspicion import (
    suspect,
    too_little_moved,
    trained_judge,
)


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

GROWING = "growing_stiction"
SLOW_ACTUATOR = (
    "Friction behind a slow actuator follows the part of the recording that was not fitted far "
    "better than friction with other physics: nothing else is named."
)
SHAKEN_LOOSE = (
    "This may be a slow actuator, or friction that OP shakes loose between two samples: the "
    "recording cannot tell, and nothing is named."
)
PERHAPS_EXCHANGED = (
    "The position moves {} before OP, so that OP may be the position and the position OP: what S "
    "and J leave out is not asked."
)


@dataclass(frozen=True, kw_only=True)
class _Fitted:
    """A case that has been assessed and, where there is no obstacle, fitted.

    ``recording`` is what was fitted, on its own clock: all of the case's, or its ``stretch``;
    ``masked`` the same without what record effects spoilt. ``fit`` and ``sample`` are in percent of
    travel where there is a ``curve`` from OP to stroke, else in percent of OP, which is then the
    same.
    """

    case: Case
    assessment: Assessment  # of the whole recording, on its own clock
    recording: Recording
    masked: Recording
    stretch: FitWindow | None = None
    late_s: float = 0.0  # by which OP was shifted earlier in ``masked``
    perhaps_exchanged: bool = False  # OP seems late, and may as well be the position
    within_steps: bool = False  # OP was reconstructed within its coarse steps from PV and set point
    curve: StrokeCurve | None = None
    curve_changed: str = ""  # how it differs from the known curve, or empty
    fit: StickSlipFit | None = None
    sample: StickSlipSample | None = None
    archive: Archive | None = None
    dead_bands: tuple[DeadBand, ...] = ()  # of a slow archive, see ``decision.shaken_loose``
    seconds: float = 0.0


def screen(cases: Sequence[Case], options: Options = DEFAULTS) -> list[Screening]:
    """One ``Screening`` for each case, in order. Never raises for what a recording holds."""
    fitted = [_fit_or_reason(case, options.limits) for case in cases]
    networks = _train(fitted, options)
    return [
        _conclude_or_reason(valve, network, options) if isinstance(valve, _Fitted) else valve
        for valve, network in zip(fitted, networks, strict=True)
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


def _crashed(case: Case, error: Exception) -> Screening:
    reason = f"the fit broke down on this recording ({type(error).__name__}: {error})."
    advice = "Report this with the recording; the other valves are not affected."
    recording = case.recording
    return replace(
        failed(recording.valve, reason, advice, recording.provenance),
        no_verdict=NoVerdict.BROKE_DOWN,
        recording=recording,
    )


def _fit_or_reason(case: Case, limits: Limits) -> _Fitted | Screening:
    try:
        return _fit(case, limits)
    except Exception as error:  # one valve must not end a plant's run
        return _crashed(case, error)


def _fit(case: Case, limits: Limits) -> _Fitted:
    """The case, assessed; fitted as well where nothing is in the way."""
    started = time.perf_counter()
    paced = at_loop_pace(in_percent(case.recording), round(limits.fitted_samples))
    recording = on_own_clock(paced)
    assessment = assess(recording, limits)
    fitted = _Fitted(
        case=replace(case, recording=paced),
        assessment=assessment,
        recording=recording,
        masked=assessment.recording,
    )
    if not assessment.obstacles:
        fitted = _fit_part(fitted, limits)
    return replace(fitted, seconds=time.perf_counter() - started)


def _fit_part(assessed: _Fitted, limits: Limits) -> _Fitted:
    """The part with the most movement fitted, unless its command shows another obstacle."""
    recording, masked, stretch = _to_fit(assessed.recording, assessed.assessment, limits)
    command = prepare_command(masked, assessed.case.known_curve)
    prepared = replace(
        assessed,
        assessment=with_obstacles(assessed.assessment, command.obstacles),
        recording=recording,
        masked=command.on_time,
        stretch=stretch,
        late_s=command.late_s,
        perhaps_exchanged=command.perhaps_exchanged,
        within_steps=command.within_steps,
        curve=command.curve,
        curve_changed=command.curve_changed,
    )
    if command.obstacles:
        return prepared
    alone = fit_stickslip(command.commanded, command.unsure_degree, command.first_look)
    sampled, archive = as_sampled(alone, command.commanded)
    # A report by exception rests as well.
    reports = archive is not None and archive.deviation > 0.0
    bands = () if reports else dead_bands_of(sampled)
    fit = without_slow_actuator(sampled, bands)
    sample = bootstrap(fit, peaks_kept=archive is None)
    return replace(prepared, fit=fit, sample=sample, archive=archive, dead_bands=bands)


def _to_fit(
    recording: Recording, assessment: Assessment, limits: Limits
) -> tuple[Recording, Recording, FitWindow | None]:
    """The part to fit, as recorded and masked: the shortest stretch without an obstacle, where each
    one tried is twice as long as the one before; else the whole recording.
    """
    samples = round(limits.fitted_samples)
    while (stretch := choose_fit_window(recording, samples)) is not None:
        part = recording.part(stretch.first, stretch.last)
        checked = assess(part, limits)
        if not checked.obstacles:
            return part, checked.recording, stretch
        samples *= 2
    return recording, assessment.recording, None


def _train(fitted: Sequence[_Fitted | Screening], options: Options) -> list[NarxFit | None]:
    """A network for each case that has a fit, all trained together."""
    ready = [
        (index, valve.fit, valve)
        for index, valve in enumerate(fitted)
        if isinstance(valve, _Fitted) and valve.fit is not None
    ]
    trained: list[NarxFit | None] = [None] * len(fitted)
    if not ready or not options.narx:
        return trained
    examples = [
        NarxExample.of(valve.masked, fit.first_heldout, network_start(fit, valve.curve))
        for _, fit, valve in ready
    ]
    for (index, _, valve), fit in zip(
        ready, train_each(examples, options.narx_settings), strict=True
    ):
        trained[index] = fit.in_seconds(valve.recording.unit_s)
    return trained


def _conclude_or_reason(fitted: _Fitted, network: NarxFit | None, options: Options) -> Screening:
    try:
        return _conclude(fitted, network, options)
    except Exception as error:  # one valve must not end a plant's run
        return _crashed(fitted.case, error)


def _conclude(fitted: _Fitted, network: NarxFit | None, options: Options) -> Screening:
    started = time.perf_counter()
    if fitted.fit is None or fitted.sample is None:
        screening = _without_verdict(fitted)
    else:
        mismatch = _explained(fitted, network) if options.mismatch else None
        screening = _with_verdict(
            fitted, fitted.fit, fitted.sample, network, mismatch, options.limits
        )
    screening = _with_suspicion(_with_repair(screening, fitted), fitted)
    seconds = fitted.seconds + time.perf_counter() - started
    return replace(screening, seconds=seconds + (network.seconds if network else 0.0))


def _explained(fitted: _Fitted, network: NarxFit | None) -> Mismatch:
    """What S and J leave out; nothing that is settled already is looked for again. Nothing is asked
    where OP and position may be exchanged: a command has none of a stem's effects."""
    if fitted.perhaps_exchanged:
        first = duration(fitted.late_s, fitted.recording.unit_s, ".1f")
        return Mismatch.unknown(PERHAPS_EXCHANGED.format(first))
    found = explain(
        fitted.recording,
        ceiling=network.simulated if network is not None else None,
        curve=fitted.curve,
        look_for_curve=fitted.case.known_curve is None,
        late_s=fitted.late_s,
        look_within_steps=fitted.within_steps,
        restore=fitted.archive is not None,
        archive=fitted.archive,
        refused=dict.fromkeys(LIKE_A_SHAKEN_BAND, RESTS) if is_sure(fitted.dead_bands) else {},
    )
    archived = fitted.archive is not None
    if archived or fitted.fit is None or not residual.slow_actuator_is_enough(fitted.fit, found):
        return found
    return _not_named(found, SLOW_ACTUATOR)


def _with_repair(screening: Screening, fitted: _Fitted) -> Screening:
    """``screening`` of a sticking valve with the predicted effect of its repair on the loop, where
    the loop can be simulated.
    """
    if screening.verdict not in (Verdict.STICKY, Verdict.WATCH):
        return screening
    numbers = {name: indicator.value for name, indicator in screening.indicators.items()}
    slope = 1.0 if fitted.curve is None else fitted.curve.slope
    valve = FittedValve.of(screening.S, screening.J, numbers, slope)
    loop = valve if isinstance(valve, str) else fit_loop(fitted.case.recording, valve)
    if isinstance(loop, str):
        return screening
    repaired = indicators.of_repair(predict(loop, REPAIRED, fitted.case.target_band))
    return replace(
        screening,
        indicators={
            **screening.indicators,
            **{indicator.name: indicator for indicator in repaired},
        },
    )


def _with_suspicion(screening: Screening, fitted: _Fitted) -> Screening:
    """``screening`` with the evidence of OP and PV alone. Without a position it is the only
    evidence; with one it is a cross-check that changes no verdict.
    """
    suspicion = suspect(fitted.case.recording, trained_judge())
    for obstacle in fitted.assessment.obstacles[:1]:  # the first one is the reason that is given
        if obstacle.slug in OP_AT_REST:
            suspicion = too_little_moved(suspicion, obstacle.reason, obstacle.remedy)
    numbers = {indicator.name: indicator for indicator in indicators.of_suspicion(suspicion)}
    return replace(
        screening, without_position=suspicion, indicators={**screening.indicators, **numbers}
    )


def _screening(
    fitted: _Fitted,
    judgement: Decision,
    S: Estimate,
    J: Estimate,
    residuals: dict[str, Residual | None],
    numbers: list[Indicator],
) -> Screening:
    recording = _remembering(fitted.case.recording, fitted)
    undecided = judgement.verdict is Verdict.UNDETERMINED
    return Screening(
        valve=recording.valve,
        verdict=judgement.verdict,
        reason=" ".join(filter(None, (judgement.reason, fitted.curve_changed))),
        advice=judgement.advice,
        shape=judgement.shape,
        severity=judgement.severity,
        confidence=judgement.confidence,
        no_verdict=judgement.no_verdict,
        S=S,
        J=J,
        residuals=residuals,
        quality=fitted.assessment.quality,
        indicators={
            indicator.name: indicator
            for indicator in indicators.in_seconds(numbers, fitted.recording)
        },
        still_seen=facts_without_verdict(recording) if undecided else (),
        baseline_note=fitted.case.baseline_note,
        recording=recording,
        provenance=recording.provenance,
        histograms=position_histograms(fitted.case.recording),
        changed=fitted.curve_changed,
    )


def _remembering(recording: Recording, fitted: _Fitted) -> Recording:
    """The recording with sentences in its provenance: what was fitted, and through which curve."""
    sentences = [window_sentence(fitted.stretch, recording)] if fitted.stretch is not None else []
    if fitted.late_s:
        sentences += [late_effect(fitted.late_s, fitted.recording.unit_s).sentence]
    sentences += [sentence for sentence in [scan_sentence(fitted.recording)] if sentence]
    sentences += [WITHIN_STEPS] if fitted.within_steps else []
    sentences += [fitted.curve.sentence()] if fitted.curve is not None else []
    if fitted.archive is not None and fitted.fit is not None:
        sentences.append(fitted.archive.sentence(_missed(fitted, fitted.fit)))
    if not sentences:
        return recording
    decisions = (*recording.provenance.decisions, *sentences)
    return replace(recording, provenance=replace(recording.provenance, decisions=decisions))


def _without_verdict(fitted: _Fitted) -> Screening:
    obstacles: tuple[Obstacle, ...] = fitted.assessment.obstacles
    unknown = Estimate.unknown(obstacles[0].reason, unit=PERCENT)
    residuals: dict[str, Residual | None] = {"stiction": None, "narx": None, "baseline": None}
    recording = fitted.assessment.recording
    numbers = indicators.of_recording(recording)
    screening = _screening(fitted, undetermined(obstacles), unknown, unknown, residuals, numbers)
    return replace(screening, open_question=on_site(None, recording, fitted.curve))


def _estimate(draws: Floats, value: float) -> Estimate:
    low, high = interval(draws, value)
    return Estimate(value=value, low=low, high=high, unit=PERCENT)


def _stiction(
    fitted: _Fitted, fit: StickSlipFit, sample: StickSlipSample, mismatch: Mismatch | None
) -> tuple[Estimate, Estimate, Floats]:
    """S, J and draws of S, percent of OP: those of the fit with the named effects, if any."""
    if mismatch is not None and mismatch.effects and mismatch.restated.S.value is not None:
        restated = mismatch.restated
        return restated.S, restated.J, spread_of(restated.S)
    S, J, S_draws = _stiction_alone(fitted, fit, sample)
    if mismatch is not None and _lag_is_doubtful(fitted, fit, mismatch, S, J):
        # Only this fit needs the lag, and the recording does not show which of the two is right.
        # Breakaways that were read with the lag, and not by a run of their own, say nothing then.
        naive, restated = mismatch.naive, mismatch.restated
        by_a_run = fit.breakaways is None
        S = restated.S.holding(*((S, naive.S) if by_a_run else (naive.S,)))
        J = restated.J.holding(*((J, naive.J) if by_a_run else (naive.J,)))
        S_draws = spread_of(S)
    return S, J, S_draws


def _stiction_alone(
    fitted: _Fitted, fit: StickSlipFit, sample: StickSlipSample
) -> tuple[Estimate, Estimate, Floats]:
    """S, J and draws of S of the stick-slip fit, percent of OP, with what the archive lost."""
    S, J, S_draws = _estimate(sample.S, fit.S), _estimate(sample.J, fit.J), sample.S
    if fitted.archive is not None:
        S, J = fitted.archive.restored(S, J, _missed(fitted, fit))
        S_draws = S_draws if S.value is None else spread_of(S)
    if fitted.curve is not None:
        S, J = fitted.curve.in_op(S), fitted.curve.in_op(J, is_jump=True)
        S_draws = S_draws / abs(fitted.curve.slope)
    return S, J, S_draws


def _lag_is_doubtful(
    fitted: _Fitted, fit: StickSlipFit, mismatch: Mismatch, S: Estimate, J: Estimate
) -> bool:
    """Whether a lag fitted beside friction has taken part of S or J although the whole record is
    explained without it: S and J of an assimilated fit contradict it.
    """
    if fit.hypothesis != "both" or fitted.archive is not None:
        return False
    explained = mismatch.finding is Finding.NONE
    restated = mismatch.restated
    return explained and (restated.S.contradicts(S) or restated.J.contradicts(J))


def _missed(fitted: _Fitted, fit: StickSlipFit) -> float:
    """By how much S and J are too small because the archive lost peaks of OP, percent of travel."""
    if fitted.archive is None:
        return 0.0
    return fitted.archive.missed_by(fit.evaluator.problem, fit.evaluator.simulate(fit.candidate))


def _with_verdict(
    fitted: _Fitted,
    fit: StickSlipFit,
    sample: StickSlipSample,
    network: NarxFit | None,
    mismatch: Mismatch | None,
    limits: Limits,
) -> Screening:
    S, J, S_draws = _stiction(fitted, fit, sample, mismatch)
    # A network is stored in seconds.
    compared = residual.of_baseline(fitted.case.baseline, off_own_clock(fitted.masked))
    residuals = {
        "stiction": residual.of_stiction(fit, resynced=False),
        "narx": residual.of_narx(network),
        "baseline": compared.residual,
    }
    events = fit.events
    evidence = DecisionEvidence(
        S=S,
        J=J,
        S_draws=S_draws,
        friction_mean=fit.of_sticking.mean,
        friction_t=fit.of_sticking.t,
        jumps_evident=events.evident,
        following=residual.better_of(residual.of_stiction(fit, resynced=True), mismatch),
        narx=residuals["narx"],
        unseen=residual.of_unknown(mismatch),
        typical_percent=residual.typical_percent(fit),
        sigma=fit.evaluator.problem.sigma,
        slow=beside_friction(fit, mismatch),
        baseline=compared.residual,
        baseline_ratio=compared.ratio,
        cycling_s=_cycling_s(fitted.recording),
        both_in=range_of_both(fitted.case.recording),
        op_in=range_of_op(fitted.case.recording),
        sampling=fitted.archive.reason if fitted.archive is not None else "",
        unit_s=fitted.recording.unit_s,
        swings=_own_swing(fit, mismatch),
        pulses=find_pulses(fit),
        curve_is_enough=residual.curve_is_enough(fit),
        steps=way_in_a_sample(fit.evaluator.problem) if fit.in_steps else 0.0,
        changed=_changed(fitted, fit, mismatch),
        leads_s=fitted.late_s if fitted.perhaps_exchanged else 0.0,
        takes_s=actuator_takes_s(fit, mismatch),
        without_lag=_S_alone(fitted, fit) if fit.hypothesis == "both" else 0.0,
        rests=is_sure(fitted.dead_bands),
        shaken=_shaken(fitted, fit, mismatch),
        S_unseen=_S_unseen(fitted, fit, S),
    )
    judgement = decide(evidence, limits)
    if not judgement.numbers_hold:
        S = J = Estimate.unknown(judgement.reason, unit=PERCENT)
    sticks = judgement.verdict is Verdict.STICKY
    may_be_S = evidence.may_stick_unseen(limits) and not sticks
    mismatch = _as_shown(mismatch, S, J, may_be_S=may_be_S, hidden=evidence.is_hidden(limits))
    numbers = [
        *indicators.of_recording(fitted.assessment.recording),
        *_movement(fitted, fit, events),
        *indicators.of_friction(fit, S, J, _op_per_travel(fitted)),
        *indicators.of_residuals(residuals, compared.ratio),
    ]
    screening = _screening(fitted, judgement, S, J, residuals, numbers)
    return replace(
        screening,
        mismatch=_on_whole_clock(mismatch, fitted),
        stroke_curve=fitted.curve,
        baseline_note=" ".join(filter(None, (fitted.case.baseline_note, compared.reason))),
        network=network.network if network is not None else None,
        traces=_traces(fitted, fit, network),
    )


def _cycling_s(recording: Recording) -> float | None:
    """The period of OP's regular oscillation, on the record's own clock."""
    cycle = signal_oscillation(recording.op, recording.interval_s)
    return cycle.period_s if cycle is not None and cycle.regular else None


def _op_per_travel(fitted: _Fitted) -> float:
    """Percent of OP for a percent of travel."""
    return 1.0 if fitted.curve is None else 1.0 / abs(fitted.curve.slope)


def _S_alone(fitted: _Fitted, fit: StickSlipFit) -> float:
    """S of S and J alone, percent of OP."""
    return S_and_J(fit.naive)[0] * _op_per_travel(fitted)


def _shaken(fitted: _Fitted, fit: StickSlipFit, mismatch: Mismatch | None) -> float:
    """S of friction that may be shaken loose between samples, percent of OP; else 0."""
    may_be = may_be_shaken(fit, mismatch, fitted.dead_bands, S_and_J(fit.naive)[0])
    return _S_alone(fitted, fit) if may_be else 0.0


def _S_unseen(fitted: _Fitted, fit: StickSlipFit, S: Estimate) -> float:
    """The S that may be there, percent of OP, where noise of OP shakes the stem loose between
    samples; 0 where not even S is known."""
    slope = _op_per_travel(fitted)
    return 0.0 if S.value is None else slope * S_unseen(fit, S.value / slope)


def _as_shown(
    mismatch: Mismatch | None, S: Estimate, J: Estimate, *, may_be_S: bool, hidden: bool
) -> Mismatch | None:
    """``mismatch`` with the one S and J of a valve and window, wherever they are shown, and without
    the slow actuator that ``may_be_S``, or an S that noise of OP may have ``hidden``."""
    if mismatch is None:
        return None
    shown = _not_named(mismatch, SHAKEN_LOOSE) if may_be_S else mismatch
    if hidden and any(effect.slug in LIKE_A_SHAKEN_BAND for effect in shown.effects):
        shown = _not_named(shown, SHAKEN_LOOSE)
    return replace(shown, restated=Stiction(S=S, J=J))


def _not_named(found: Mismatch, reason: str) -> Mismatch:
    """``found`` without what it named, and why."""
    return Mismatch.unknown(reason, record_effects=found.record_effects, seconds=found.seconds)


def _changed(
    fitted: _Fitted, fit: StickSlipFit, mismatch: Mismatch | None
) -> ChangeOfStiction | None:
    """The change of S within what was fitted, percent of OP, where none that goes on was named."""
    if mismatch is not None and any(one.slug == GROWING for one in mismatch.effects):
        return None
    changed = change_of_stiction(fit)
    if changed is None or fitted.curve is None:
        return changed
    slope = abs(fitted.curve.slope)
    return replace(changed, before=changed.before / slope, after=changed.after / slope)


def _own_swing(fit: StickSlipFit, mismatch: Mismatch | None) -> OwnSwing | None:
    """The swing of the position that its command does not have, where nothing was named that may
    be its cause."""
    named = () if mismatch is None else mismatch.effects
    if any(catalogue()[one.slug].may_swing for one in named):
        return None
    return own_swing(fit.evaluator.problem, fit.evaluator.simulate(fit.candidate, resynced=True))


def _movement(fitted: _Fitted, fit: StickSlipFit, events: SlipEvents) -> list[Indicator]:
    """How the stem moved in the whole recording, whatever part of it was fitted."""
    if fitted.stretch is None:
        return indicators.of_movement(fit.evaluator.problem, events)
    whole_problem = make_problem(in_travel(fitted.assessment.recording, fitted.curve))
    evaluator = replace(fit.evaluator, problem=whole_problem)
    return indicators.of_movement(whole_problem, replace(fit, evaluator=evaluator).events)


def _traces(fitted: _Fitted, fit: StickSlipFit, network: NarxFit | None) -> Traces:
    """The free runs on the clock of the whole recording."""
    stiction, narx = fit.heldout(), network.simulated if network is not None else None
    if fitted.stretch is None:
        return Traces(stiction=stiction, narx=narx, heldout_from=fit.first_heldout)
    first, samples = fitted.stretch.first, len(fitted.case.recording)
    return Traces(
        stiction=on_whole_clock(stiction, first, samples),
        narx=None if narx is None else on_whole_clock(narx, first, samples),
        heldout_from=first + fit.first_heldout,
    )


def _on_whole_clock(mismatch: Mismatch | None, fitted: _Fitted) -> Mismatch | None:
    """The mismatch with its free runs on the clock of the whole recording."""
    if mismatch is None or mismatch.runs is None or fitted.stretch is None:
        return mismatch
    runs = mismatch.runs.within(fitted.stretch.first, len(fitted.case.recording))
    return replace(mismatch, runs=runs)
