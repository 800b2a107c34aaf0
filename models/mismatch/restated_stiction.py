"""S and J of friction alone beside those with the named effects, and what a slow archive lost of
OP's peaks put back.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.acceptance.effects_that_stand import STRAIGHT_LINE
from stemwatch.models.mismatch.acceptance.whole_record import AcceptedHypothesis
from stemwatch.models.mismatch.clocks_or_dead_time import DELAY
from stemwatch.models.mismatch.findings import Finding, Mismatch, Stiction
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_fit import naive_layout
from stemwatch.models.mismatch.fit.evaluator import DRIVE, Evaluator
from stemwatch.models.mismatch.fit.uncertainty import draws
from stemwatch.models.mismatch.measurement.between_samples import (
    Archive,
    find_archive,
    stands_for_friction,
)
from stemwatch.models.mismatch.prepared_recording import PreparedRecording
from stemwatch.models.mismatch.stiction import (
    holding_no_jump,
    jump_within_a_step,
    of_balance,
    of_candidate,
    stiction,
)
from stemwatch.models.mismatch.term import ActsOn
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.breakaways import LATE

# Effects that delay the stem by an amount that grows with the speed of its command, as friction
# does.
LAGS = ("actuator_lag", "asymmetric_lag", "viscous_drag", "underdamped_positioner")


def stictions(
    case: PreparedRecording,
    hypothesis: AcceptedHypothesis,
    naive_only: Evaluator,
    naive: Floats,
    archive: Archive | None,
) -> tuple[Stiction, Stiction]:
    """S and J of friction ``naive`` alone and of the hypothesis, each with its intervals."""
    evaluator, effects = hypothesis.evaluator, hypothesis.effects
    # Where no named effect moves the levels, and every sample was kept, the breakaways give the
    # best S and J: a drift of the reading shifts both directions and not their mean.
    can_be_restated = (
        not hypothesis.unexplained and not hypothesis.dropped_because and archive is None
    )
    can_be_restated = can_be_restated and all(
        effect.slug in (*STRAIGHT_LINE, DELAY) for effect in effects
    )
    fitted = (hypothesis.best,) if effects else (naive, hypothesis.best)
    elements = fitted if can_be_restated else ()
    simple = naive_layout(naive_only)
    friction_alone = stiction(
        naive_only, lambda: draws(naive_only, simple, naive), naive, () if effects else elements
    )
    refitted = stiction(
        evaluator,
        hypothesis.drawn,
        hypothesis.best,
        elements,
        _delay_s(hypothesis),
        with_lag=any(effect.slug in LAGS for effect in effects),
    )
    if case.balance is not None and DRIVE in hypothesis.layout.places:
        refitted = of_balance(case.balance, refitted)
    if effects and (not elements or jump_within_a_step(evaluator.problem, refitted)):
        refitted = holding_no_jump(evaluator, hypothesis.fitted, refitted)
    for S, J in of_rivals(hypothesis):
        # The rivals cannot be separated, so the intervals must hold the S and J of each of them.
        refitted = Stiction(S=refitted.S.holding(S), J=refitted.J.holding(J))
    return friction_alone, refitted


def of_rivals(hypothesis: AcceptedHypothesis) -> Iterator[tuple[Estimate, Estimate]]:
    """S and J of the models that the recording cannot separate from the last effect found."""
    if not hypothesis.named.needed or not hypothesis.effects:
        return
    for rival in hypothesis.named.needed[-1].stage.accepted[1:]:
        middle = rival.fitted.candidates.mean(axis=0)
        yield of_candidate(middle)


def _delay_s(hypothesis: AcceptedHypothesis) -> float:
    """The dead time that was named, less what stems usually are late by; 0 where none was."""
    coordinate_slice = hypothesis.layout.places.get(DELAY)
    if coordinate_slice is None or all(effect.slug != DELAY for effect in hypothesis.effects):
        return 0.0
    usual_s = LATE[0] * hypothesis.evaluator.problem.interval_s
    return max(float(hypothesis.best[coordinate_slice][0]) - usual_s, 0.0)


def archive_of(case: PreparedRecording, evaluator: Evaluator, best: Floats) -> Archive | None:
    """The slow archive that S and J are restored from, if any."""
    if not case.measured.restore or case.measured.archive is not None:
        return case.measured.archive
    archive = find_archive(case.recording)
    if archive is None:
        return None
    gain, zero = 1.0 + float(best[base_coordinate.GAIN]), float(best[base_coordinate.ZERO])
    return archive.with_slips(evaluator.problem, gain, zero)


def with_peaks_restored(mismatch: Mismatch, archive: Archive, evaluator: Evaluator) -> Mismatch:
    """The mismatch with S and J raised by what a slow archive lost of OP's peaks."""
    restated, naive = mismatch.restated, mismatch.naive
    in_place = stands_for_friction(restated.S, naive.S)
    if mismatch.finding is Finding.UNKNOWN or (in_place and archive.deviation <= 0.0):
        return mismatch
    # A distance between command and stem that a slow actuator causes was not lost between samples.
    slow = any(catalogue()[effect.slug].acts_on is ActsOn.COMMAND for effect in mismatch.effects)
    if mismatch.runs is None or (slow and archive.deviation <= 0.0):
        return mismatch
    missed = archive.missed_by(evaluator.problem, mismatch.runs.extended)
    S, J = archive.restored(restated.S, restated.J, missed)
    return replace(
        mismatch,
        restated=Stiction(S=S, J=J),
        record_effects=(*mismatch.record_effects, archive.as_effect(missed)),
    )
