"""The evidence on a fitted valve, as the verdict weighs it: in percent of OP, with every way in
which the fit may be misled.
"""

from __future__ import annotations

from dataclasses import replace

from stemwatch.models.decision import residual
from stemwatch.models.decision.beside_friction import actuator_takes_s, beside_friction
from stemwatch.models.decision.decision_evidence import DecisionEvidence
from stemwatch.models.decision.reading_off import ReadingOff, reading_off
from stemwatch.models.decision.residual import BaselineComparison
from stemwatch.models.decision.shaken_loose import is_sure, may_be_shaken
from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.mismatch.measurement.between_samples import ArchiveKind
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.record_checks.on_a_stop import Stop
from stemwatch.models.record_checks.own_swing import OwnSwing, own_swing
from stemwatch.models.record_checks.pulsing_stem import find_pulses
from stemwatch.models.record_checks.wandering_reading import Wander, find_wander
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.screening.fitted_recording import FittedRecording
from stemwatch.models.screening.hidden_stiction import S_if_averaged, S_that_may_be_hidden
from stemwatch.models.screening_result import Residual
from stemwatch.models.signals.oscillation import signal_oscillation
from stemwatch.models.stickslip.change_of_stiction import ChangeOfStiction, change_of_stiction
from stemwatch.models.stickslip.fit import StickSlipFit
from stemwatch.models.stickslip.interval import way_in_a_sample
from stemwatch.models.stickslip.parameters import S_and_J
from stemwatch.models.stickslip.stored_range import range_of_both, range_of_op

GROWING, STOP = "growing_stiction", "travel_stop"


def evidence_of(
    fitted: FittedRecording,
    stiction: tuple[Estimate, Estimate, Floats],
    narx: Residual | None,
    baseline: BaselineComparison,
    mismatch: Mismatch | None,
) -> DecisionEvidence:
    """What the fits of a recording say; ``stiction`` is S, J and draws of S, percent of OP."""
    fit, (S, J, S_draws) = fitted.fit, stiction
    return DecisionEvidence(
        S=S,
        J=J,
        S_draws=S_draws,
        friction_mean=fit.of_sticking.mean,
        friction_t=fit.of_sticking.t,
        jumps_evident=fit.events.evident,
        following=residual.better_of(residual.of_stiction(fit, resynced=True), mismatch),
        narx=narx,
        unseen=residual.of_unknown(mismatch),
        typical_percent=residual.typical_percent(fit),
        sigma=fit.evaluator.problem.sigma,
        slow=beside_friction(fit, mismatch),
        baseline=baseline.residual,
        baseline_ratio=baseline.ratio,
        cycling_s=_cycling_s(fitted.recording),
        both_in=range_of_both(fitted.whole),
        op_in=range_of_op(fitted.whole),
        sampling=fitted.archive.reason if fitted.archive is not None else "",
        unit_s=fitted.recording.unit_s,
        every_s=fitted.recording.interval_s,
        swings=_own_swing(fit, mismatch),
        pulses=find_pulses(fit),
        curve_is_enough=residual.curve_is_enough(fit),
        steps=way_in_a_sample(fit.evaluator.problem) if fit.in_steps else 0.0,
        changed=_changed(fitted, mismatch),
        leads_s=fitted.late_s if fitted.perhaps_exchanged else 0.0,
        takes_s=actuator_takes_s(fit, mismatch),
        without_lag=fitted.S_alone if fit.hypothesis == "both" else 0.0,
        rests=is_sure(fitted.dead_bands),
        shaken=_shaken(fitted, mismatch),
        S_unseen=S_that_may_be_hidden(fitted, S),
        S_averaged=S_if_averaged(fitted, S),
        stop=_stop(fitted, mismatch),
        wander=_wander(fitted, mismatch),
        off=_reading_off(fitted, mismatch),
    )


def _reading_off(fitted: FittedRecording, mismatch: Mismatch | None) -> ReadingOff | None:
    """By how much the position stands beside OP, where both are in percent and nothing was named
    that may be the cause."""
    recording, in_percent = fitted.recording, fitted.fit.evaluator.problem.mv_is_percent
    if not in_percent or (mismatch is not None and mismatch.effects):
        return None
    return reading_off(recording.op.values[recording.usable], fitted.curve, fitted.fit.candidate)


def _wander(fitted: FittedRecording, mismatch: Mismatch | None) -> Wander | None:
    """The wander of the position reading, where nothing was named that may look so."""
    if mismatch is not None and mismatch.effects:
        return None
    wander, archive = find_wander(fitted.assessment.recording), fitted.archive
    if wander is None or archive is None or archive.kind is not ArchiveKind.LINES:
        return wander
    # OP and position may each lie a deviation above their lines, and a deviation below.
    return wander if wander.percent > 4.0 * archive.deviation else None


def _stop(fitted: FittedRecording, mismatch: Mismatch | None) -> Stop | None:
    """The stop on which the stem stood, unless it was named."""
    named = () if mismatch is None else mismatch.effects
    return None if any(one.slug == STOP for one in named) else fitted.assessment.stop


def _cycling_s(recording: Recording) -> float | None:
    """The period of OP's regular oscillation, on the record's own clock."""
    cycle = signal_oscillation(recording.op, recording.interval_s)
    return cycle.period_s if cycle is not None and cycle.regular else None


def _own_swing(fit: StickSlipFit, mismatch: Mismatch | None) -> OwnSwing | None:
    """The swing of the position that its command does not have, where nothing was named that may
    be its cause."""
    named = () if mismatch is None else mismatch.effects
    if any(catalogue()[one.slug].may_swing for one in named):
        return None
    return own_swing(fit.evaluator.problem, fit.evaluator.simulate(fit.candidate, resynced=True))


def _changed(fitted: FittedRecording, mismatch: Mismatch | None) -> ChangeOfStiction | None:
    """The change of S within what was fitted, percent of OP, where none that goes on was named."""
    if mismatch is not None and any(one.slug == GROWING for one in mismatch.effects):
        return None
    changed = change_of_stiction(fitted.fit)
    if changed is None or fitted.curve is None:
        return changed
    slope = abs(fitted.curve.slope)
    return replace(changed, before=changed.before / slope, after=changed.after / slope)


def _shaken(fitted: FittedRecording, mismatch: Mismatch | None) -> float:
    """S of friction that may be shaken loose between samples, percent of OP; else 0."""
    fit = fitted.fit
    may_be = may_be_shaken(fit, mismatch, fitted.dead_bands, S_and_J(fit.naive)[0])
    return fitted.S_alone if may_be else 0.0
