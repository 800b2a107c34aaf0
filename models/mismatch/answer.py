"""The answer that follows from the accepted hypothesis: the finding and its sentence, S and J, and
the residual before and after.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch.acceptance.accepted_hypothesis import accepted_hypothesis
from stemwatch.models.mismatch.acceptance.held_out import HeldOutComparison
from stemwatch.models.mismatch.acceptance.last_checks import checked
from stemwatch.models.mismatch.acceptance.nothing_left_out import doubt, missed_breakaways
from stemwatch.models.mismatch.acceptance.rivals import left_open
from stemwatch.models.mismatch.acceptance.whole_record import AcceptedHypothesis
from stemwatch.models.mismatch.acceptance_limits import chance
from stemwatch.models.mismatch.clocks_or_dead_time import DELAY, but_for_clocks
from stemwatch.models.mismatch.evidence.describe_effect import (
    in_order_of_work,
    residual_map,
    sentence_of,
)
from stemwatch.models.mismatch.findings import (
    Effect,
    Finding,
    Mismatch,
    ResidualMap,
    Stiction,
    Untestable,
)
from stemwatch.models.mismatch.fit.base_fit import fit_naive, naive_evaluator
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.evaluator import DRIVE, Evaluator
from stemwatch.models.mismatch.measurement.record_effects import MeasuredRecord
from stemwatch.models.mismatch.prepared_recording import PreparedRecording
from stemwatch.models.mismatch.restated_stiction import archive_of, stictions, with_peaks_restored
from stemwatch.models.mismatch.search.tried_effects import scores_of, what_was_tried
from stemwatch.models.mismatch.stiction import of_likelihood
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.preparation.own_clock import duration
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.force_balance import NOT_AS_A_WHOLE


def answer_of(case: PreparedRecording) -> Mismatch:
    """What the accepted hypothesis says of a recording, beside S and J alone."""
    hypothesis = checked(accepted_hypothesis(case))
    is_drive = case.balance is not None and case.balance.is_quick
    if is_drive and DRIVE not in hypothesis.layout.places:
        return not_testable(case.measured, NOT_AS_A_WHOLE)
    evaluator, comparison = hypothesis.evaluator, hypothesis.comparison
    naive_only = naive_evaluator(evaluator)
    naive = conclude(
        naive_only, fit_naive(naive_only, np.ones(evaluator.problem.n_blocks, dtype=bool))
    )
    archive = archive_of(case, evaluator, hypothesis.best)
    friction_alone, refitted = stictions(case, hypothesis, naive_only, naive, archive)
    unsure = _why_unsure(hypothesis, (friction_alone, refitted), naive)
    effects, delays = but_for_clocks(case, hypothesis)
    effects = in_order_of_work(effects)
    finding = _finding(effects, hypothesis.unexplained or bool(unsure))
    if not hypothesis.effects and (finding is Finding.UNKNOWN or not comparison.heldout.improves):
        comparison, refitted = comparison.of_naive_alone(), friction_alone
    if finding is Finding.NONE and archive is None and hypothesis.shaking is None:
        # Runs let go at one level, so that S and J of breakaways that scatter are others.
        refitted = of_likelihood(evaluator, hypothesis.fitted) or refitted
    before, after = _residual_maps(evaluator, comparison)
    too_small = [DELAY] if delays else []
    tried_effects, combined_gain = what_was_tried(hypothesis.named, effects, too_small)
    mismatch = Mismatch(
        finding=finding,
        sentence=_what_shakes(hypothesis)
        + sentence_of(
            finding, effects, case.refused, before, unsure, missed_breakaways(comparison)
        ),
        naive=friction_alone,
        restated=refitted,
        effects=effects,
        record_effects=(*case.measured.effects, *delays),
        not_testable=tuple(Untestable(slug=s, reason=r) for s, r in case.refused.items()),
        heldout=comparison.heldout,
        before=before,
        after=after,
        runs=comparison.runs,
        tried=tried_effects,
        together=combined_gain,
        p_value=chance(max(effect.evidence.strength for effect in effects)) if effects else None,
        open_question=left_open(
            evaluator, hypothesis.named, [effect.slug for effect in hypothesis.effects]
        ),
        scores=scores_of(hypothesis.named, hypothesis.effects),
    )
    return mismatch if archive is None else with_peaks_restored(mismatch, archive, evaluator)


def _residual_maps(
    evaluator: Evaluator, comparison: HeldOutComparison
) -> tuple[ResidualMap, ResidualMap]:
    """The residual of S and J alone and of the better model, in the same cells: place, direction
    and rests are those of the better model's stem.
    """
    naive, better = comparison.runs.naive, comparison.runs.extended
    noise = comparison.heldout.noise_floor
    before = residual_map(evaluator, naive, better, noise)
    return before, residual_map(evaluator, better, better, noise)


def _why_unsure(
    hypothesis: AcceptedHypothesis, both_stictions: tuple[Stiction, Stiction], naive: Floats
) -> str:
    """Why it cannot be said that nothing is left out, a clause; empty where it can, or where
    effects were accepted.
    """
    if hypothesis.effects or hypothesis.shaking is not None:
        return ""
    return hypothesis.dropped_because or doubt(
        hypothesis.evaluator,
        hypothesis.fitted,
        hypothesis.best,
        hypothesis.comparison,
        both_stictions,
        naive,
    )


def _what_shakes(hypothesis: AcceptedHypothesis) -> str:
    """A sentence, with a blank after it, on the swing that shakes the stem; empty where none
    does."""
    shaking, problem = hypothesis.shaking, hypothesis.evaluator.problem
    if shaking is None:
        return ""
    period = duration(shaking.period * problem.interval_s, problem.unit_s, ".3g")
    return (
        f"The stem lets go in time with a swing of {period} that OP does not have: something "
        "outside shakes it, as a pump, a pulsating flow or unsteady supply air does. "
    )


def _finding(effects: tuple[Effect, ...], unexplained: bool) -> Finding:
    """``unexplained``: without effects it cannot be said that nothing is left out."""
    if not effects:
        return Finding.UNKNOWN if unexplained else Finding.NONE
    single = all(len(effect.members) == 1 for effect in effects)
    return Finding.NAMED if single else Finding.CANDIDATES


def not_testable(measured: MeasuredRecord, reason: str) -> Mismatch:
    """The answer where nothing can be said of any effect, for a ``reason`` that is a clause."""
    return Mismatch.unknown(
        f"Nothing can be said: {reason}.",
        reason,
        record_effects=measured.effects,
        not_testable=tuple(Untestable(slug=slug, reason=reason) for slug in catalogue()),
    )
