"""The last checks of what was accepted, before it is the answer.

Where nothing is named, what runs leave must be more than the likelihood of the whole record leaves,
or S and J explain it. A free run must follow the part that was not fitted; nothing outside may
shake the stem; and what is named must not stand in for physics that is not in the catalogue. What
fails is *unknown*. What may be one cause is not named as two.
"""

from __future__ import annotations

from dataclasses import replace

from stemwatch.models.mismatch.acceptance.accepted_hypothesis import parts_only
from stemwatch.models.mismatch.acceptance.effects_that_stand import STRAIGHT_LINE
from stemwatch.models.mismatch.acceptance.misleading_runs import NOISE_OF_A_NAME
from stemwatch.models.mismatch.acceptance.nothing_left_out import likelihood_explains
from stemwatch.models.mismatch.acceptance.one_cause import one_cause
from stemwatch.models.mismatch.acceptance.shaken_stem import find_shaking
from stemwatch.models.mismatch.acceptance.whole_record import LEAST_FIT_OF_NAMED, AcceptedHypothesis
from stemwatch.models.mismatch.acceptance_limits import MEAN_OF_A_LINE
from stemwatch.models.mismatch.findings import Effect
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    OF_STEMS,
    RecordLikelihood,
    likeliest_of,
)
from stemwatch.models.mismatch.search.reading_errors import STICKS_AGAIN

NEAR_NOISE = 2.0  # noise floors, rmse up to which a stem that hardly moves is followed
# What physics that is not in the catalogue was taken for.
STANDS_IN = (*STRAIGHT_LINE, "actuator_lag", "asymmetric_lag")


def checked(hypothesis: AcceptedHypothesis) -> AcceptedHypothesis:
    """The hypothesis after all the checks, each of which takes it as the one before left it."""
    stands = _unless_stand_in(_unless_shaken(_if_followed(_unless_explained(hypothesis))))
    return replace(stands, effects=one_cause(stands.effects))


def _unless_explained(hypothesis: AcceptedHypothesis) -> AcceptedHypothesis:
    """The hypothesis; as one that leaves nothing out, where nothing was named and the likelihood of
    the whole record leaves nothing at the scatter of real stems. Where the noise is small, what
    runs leave in their worst blocks is that of slips that end by chance here or there.
    """
    if hypothesis.effects or not hypothesis.unexplained or hypothesis.dropped_because:
        return hypothesis
    evaluator, fitted, best = hypothesis.evaluator, hypothesis.fitted, hypothesis.best
    if not likelihood_explains(evaluator, fitted, best, scatter=OF_STEMS):
        return hypothesis
    return replace(hypothesis, unexplained=False)


def _if_followed(hypothesis: AcceptedHypothesis) -> AcceptedHypothesis:
    """The hypothesis, without its effects where a free run of it does not follow the part that was
    not fitted: as little as S and J alone then do they describe what moved the stem.

    Where OP hardly moves, a few breakaways that come late by chance decide how well a free run
    follows. If nothing systematic is left and the free run comes nearer beyond chance, or if the
    likelihood, which follows all breakaways, leaves nothing of the record, they stand.
    """
    heldout = hypothesis.comparison.heldout
    if not hypothesis.effects or heldout.fit_extended is None or heldout.rmse_extended is None:
        return hypothesis
    # A stem that hardly moves in its noise is followed as well as can be.
    noise = NEAR_NOISE * (heldout.noise_floor or 0.0)
    if heldout.fit_extended >= LEAST_FIT_OF_NAMED or heldout.rmse_extended <= noise:
        return hypothesis
    if not hypothesis.unexplained and (heldout.gain_low or 0.0) > 0.0:
        return hypothesis
    evaluator, fitted, best = hypothesis.evaluator, hypothesis.fitted, hypothesis.best
    if likelihood_explains(evaluator, fitted, best, NOISE_OF_A_NAME):
        return hypothesis
    reason = parts_only(hypothesis, "not followed with it either")
    return replace(hypothesis, effects=(), dropped_because=reason)


def _unless_shaken(hypothesis: AcceptedHypothesis) -> AcceptedHypothesis:
    """The hypothesis; with nothing named, and as one that leaves something out, where something
    outside shakes the stem. A shaken stem moves in steps, so that it seems to stick again; and it
    lets go in small slips ahead of its level, so that the likelihood takes it for a stem that
    slides slowly. What trajectories show beside that stands.
    """
    if any(not _shaking_explains(effect) for effect in hypothesis.effects):
        return hypothesis
    shaking = find_shaking(hypothesis.evaluator, hypothesis.fitted)
    if shaking is None:
        return hypothesis
    return replace(hypothesis, effects=(), unexplained=True, shaking=shaking)


def _shaking_explains(effect: Effect) -> bool:
    """Whether a stem that is shaken may look like this effect."""
    return effect.slug in STICKS_AGAIN or effect.evidence.likelihood_gain > 0.0


def _unless_stand_in(hypothesis: AcceptedHypothesis) -> AcceptedHypothesis:
    """The hypothesis; with nothing named, and as one that leaves something out, where all that is
    named are lines of the reading and lags, and the most likely stem with them is further from the
    readings than noise is. They bend to what a spring with hysteresis or a wave of friction does.
    Asked where runs leave more than noise, and of lines that do not explain nearly all of the rest.
    """
    slugs = {effect.slug for effect in hypothesis.effects}
    if not slugs or not slugs <= set(STANDS_IN):
        return hypothesis
    weak = max(effect.evidence.mean for effect in hypothesis.effects) < MEAN_OF_A_LINE
    if not hypothesis.unexplained and not (weak and slugs <= set(STRAIGHT_LINE)):
        return hypothesis
    found = likeliest_of(RecordLikelihood(hypothesis.evaluator), hypothesis.fitted)
    if found.noise <= NOISE_OF_A_NAME * hypothesis.evaluator.problem.sigma:
        return hypothesis
    return replace(hypothesis, effects=(), unexplained=True)
