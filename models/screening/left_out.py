"""What S and J leave out of a fitted recording: where it is asked at all, and what is not named
because friction explains it as well.
"""

from __future__ import annotations

from dataclasses import replace

from stemwatch.models.decision import residual
from stemwatch.models.decision.shaken_loose import (
    LIKE_A_SHAKEN_BAND,
    OF_SLOW_ACTUATORS,
    RESTS,
    is_sure,
)
from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.mismatch.terms.slip_overshoot import SlipOvershoot
from stemwatch.models.narx.example import NarxFit
from stemwatch.models.preparation.own_clock import duration
from stemwatch.models.screening.fitted_recording import FittedRecording
from stemwatch.models.screening.published_stiction import of_stickslip_fit, stands_behind_reports

SLOW_ACTUATOR = (
    "Friction behind a slow actuator follows the part of the recording that was not fitted far "
    "better than friction with other physics: nothing else is named."
)
SHAKEN_LOOSE = (
    "This may be a slow actuator, or friction that OP shakes loose between two samples: the "
    "recording cannot tell, and nothing is named."
)
LATE_REPORTS = (
    "This may be a slow actuator, or friction: reports by exception come late, as behind a lag. "
    "The recording cannot tell, and nothing is named."
)
SHORTER_SLIPS = (
    "The physics that would explain this recording needs longer slips than those that S and J "
    "alone follow: the recording cannot tell whether anything is left out, and nothing is named."
)
PERHAPS_EXCHANGED = (
    "The position moves {} before OP, so that OP may be the position and the position OP: what S "
    "and J leave out is not asked."
)


def explained(
    fitted: FittedRecording, network: NarxFit | None, *, look_for_curve: bool
) -> Mismatch:
    """What S and J leave out; nothing that is settled already is looked for again. Nothing is asked
    where OP and position may be exchanged: a command has none of a stem's effects."""
    if fitted.perhaps_exchanged:
        first = duration(fitted.late_s, fitted.recording.unit_s, ".1f")
        return Mismatch.unknown(PERHAPS_EXCHANGED.format(first))
    found = explain(
        fitted.recording,
        ceiling=network.simulated if network is not None else None,
        curve=fitted.curve,
        look_for_curve=look_for_curve,
        late_s=fitted.late_s,
        look_within_steps=fitted.within_steps,
        restore=fitted.archive is not None,
        archive=fitted.archive,
        refused=dict.fromkeys(LIKE_A_SHAKEN_BAND, RESTS) if is_sure(fitted.dead_bands) else {},
    )
    if fitted.archive is not None:
        return found
    if residual.slow_actuator_is_enough(fitted.fit, found):
        return _not_named(found, SLOW_ACTUATOR)
    if _slips_are_shorter(fitted, found):
        return _not_named(found, SHORTER_SLIPS)
    return found


def _slips_are_shorter(fitted: FittedRecording, found: Mismatch) -> bool:
    """Whether slips that overshoot are named beside another effect, with a J above that of the
    stick-slip fit, and J and S contradict the intervals of that fit.

    A stem that sticks again at each sample behind a drag or a slow actuator makes only the first
    part of each slip, so that twice the J there looks like the J of a quick one.
    """
    if len(found.effects) < 2 or not any(e.slug == SlipOvershoot.slug for e in found.effects):
        return False
    S, J = of_stickslip_fit(fitted)[:2]
    restated = found.restated
    if restated.J.value is None or J.value is None or restated.J.value <= J.value:
        return False
    return restated.S.contradicts(S) and restated.J.contradicts(J)


def as_shown(
    mismatch: Mismatch,
    fitted: FittedRecording,
    S: Estimate,
    J: Estimate,
    *,
    may_be_S: bool,
    hidden: bool,
) -> Mismatch:
    """``mismatch`` with the one S and J of a valve and window, wherever they are shown, with its
    free runs on the clock of the whole recording, and without the slow actuator that
    ``may_be_S``, an S that noise of OP may have ``hidden``, or late reports."""
    shown = _not_named(mismatch, SHAKEN_LOOSE) if may_be_S else mismatch
    if _may_be_late_reports(shown, fitted):
        shown = _not_named(shown, LATE_REPORTS)
    if hidden and any(effect.slug in LIKE_A_SHAKEN_BAND for effect in shown.effects):
        shown = _not_named(shown, SHAKEN_LOOSE)
    if shown.runs is not None and fitted.stretch is not None:
        runs = shown.runs.within(fitted.stretch.first, len(fitted.whole))
        shown = replace(shown, runs=runs)
    return replace(shown, restated=replace(shown.restated, S=S, J=J))


def _may_be_late_reports(found: Mismatch, fitted: FittedRecording) -> bool:
    """Whether a slow actuator behind reports by exception has most of the S of friction alone."""
    slow = any(effect.slug in OF_SLOW_ACTUATORS for effect in found.effects)
    return slow and stands_behind_reports(fitted, found.restated.S)


def _not_named(found: Mismatch, reason: str) -> Mismatch:
    """``found`` without what it named, and why."""
    return Mismatch.unknown(reason, record_effects=found.record_effects, seconds=found.seconds)
