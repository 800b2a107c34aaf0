"""Which effects stand on the whole record: those that remove a material share of the residual, and
where much is left, a good part of it. A straight line through the reading must leave no bend, and
no weaker effect stands beside a spring with hysteresis.
"""

from __future__ import annotations

from collections.abc import Sequence

from stemwatch.models.mismatch.acceptance.follows_turns import SPRING
from stemwatch.models.mismatch.acceptance_limits import (
    MEAN_OF_A_LINE,
    MEAN_WHERE_MUCH_IS_LEFT,
    convincing,
    much_left,
    not_little_left,
)
from stemwatch.models.mismatch.findings import Effect, HeldOutFit
from stemwatch.models.mismatch.fit.crossfit import Fitted, curvature
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.prepared_recording import PreparedRecording, is_compressed
from stemwatch.models.mismatch.search.named_terms import Named, shown_by_likelihood
from stemwatch.models.mismatch.search.reading_errors import FLOW
from stemwatch.models.mismatch.search.reading_rivals import BOW
from stemwatch.models.mismatch.term import ActsOn
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.mismatch.terms.flow_force import OWN_BOW

STRAIGHT_LINE = ("zero_shift", "span_error")
BEND = "bend"  # a bent reading is not in the catalogue; its limits are those of a term
LEAST_SHARE = 0.09  # of the held-out loss that an effect must remove to matter
# Share of the held-out loss from which it explains most of a record where much is left: a stop acts
# in few blocks, so that the mean over all of them is small. Of 83 development valves with rare
# physics none of the terms that stand in for it removes more than 0.31, straight lines apart.
LARGEST_PART = 0.5
MUCH_NEARER = 0.7  # rmse on unseen data over that of S and J alone
WORSE = 1.15  # rmse on unseen data over that of S and J alone, from which it refutes a line
# Share of a line's mean advantage from which a bend tells against it: beside a zero that was off it
# gained 0.05 of that, where a force over place was read as a span 0.13 (development valves).
LEAST_BEND = 0.1
AT_MOST = 1.95  # mean advantage of which nearly every block counts as much as it may
# Least strength of a weaker effect beside a spring with hysteresis. Of 27 simulated ones that were
# named (`draw_hidden`, seed 4090, and `draw_effect`, 4063, development) four had another effect
# beside them: on even places of 1.6 at most, from which this was chosen, on odd ones of 1.8.
LEAST_BESIDE_SPRING = 2.0


def large_enough(candidates: Sequence[Effect], named: Named) -> tuple[Effect, ...]:
    """The effects that remove a material share; of two that were found together, both are needed to
    remove it. A bow that a flow force may have as a part of its shape is no effect of its own, nor
    what the law of a spring's inner friction may leave.
    """
    of_pairs = {needed.term.slug for needed in named.needed if needed.of_pair}
    if named.sticks_again is not None or shown_by_likelihood(named):
        # At the S and J of the likelihood, and of a stem that sticks again, trajectories measure no
        # share; theirs stood before.
        of_pairs = {needed.term.slug for needed in named.needed}
    return tuple(
        effect
        for effect in candidates
        if (_matters(effect) or effect.slug in of_pairs)
        and not _bends_with_force(effect, named)
        and not _left_by_spring(effect, candidates)
    )


def _matters(effect: Effect) -> bool:
    """True where it removes a good share of the residual; events that tell it are few samples."""
    evidence = effect.evidence
    return (
        evidence.share >= LEAST_SHARE or evidence.events_z > 0.0 or evidence.likelihood_gain > 0.0
    )


def _bends_with_force(effect: Effect, named: Named) -> bool:
    """True for a bow that a flow force beside it may have as a part of its shape."""
    if effect.slug != BOW or FLOW not in named.fitted.layout.places:
        return False
    height = float(named.fitted.values(BOW)[:, 0].mean())
    return abs(height) <= OWN_BOW * abs(float(named.fitted.values(FLOW)[:, 0].mean()))


def _left_by_spring(effect: Effect, candidates: Sequence[Effect]) -> bool:
    """True for a weaker effect beside a spring with hysteresis, whose inner friction follows no one
    law: what it does otherwise looks like a slow drift, a sag or a lag of some tenths of its
    size."""
    spring = next((one for one in candidates if one.slug == SPRING), None)
    if spring is None or effect is spring:
        return False
    weaker = effect.evidence.mean < spring.evidence.mean
    return weaker and effect.evidence.strength < LEAST_BESIDE_SPRING


def effects_that_stand(
    case: PreparedRecording,
    evaluator: Evaluator,
    fitted: Fitted,
    effects: tuple[Effect, ...],
    heldout: HeldOutFit,
) -> tuple[tuple[Effect, ...], bool]:
    """The effects that stand although something is left, and whether that is more than noise.

    Where much is left, an effect must explain a good part of it; a straight line through the
    reading must do so nearly alone, predict the rest of the record, and leave no bend.
    """
    # A flow leaves no noise to compare with. That of an archive that drew lines is smaller than it
    # is taken for, so that what is left must be systematic, but may be more than is seen.
    unexplained = case.own_reading and not_little_left(evaluator, fitted)
    noise_known = case.own_reading and not is_compressed(case.measured)
    if noise_known and much_left(evaluator, fitted):
        much_nearer = _much_nearer(heldout)
        effects = tuple(
            effect
            for effect in effects
            if effect.evidence.mean >= _least_mean(effect)
            or (effect.evidence.share >= LARGEST_PART and effect.slug not in STRAIGHT_LINE)
            or (much_nearer and _of_air(effect))
        )
    lines = [effect.evidence.mean for effect in effects if effect.slug in STRAIGHT_LINE]
    bent = lines and not _is_nearly_all(lines, heldout) and _is_bent(evaluator, fitted, max(lines))
    if bent or (lines and _refuted(heldout)):
        effects = tuple(effect for effect in effects if effect.slug not in STRAIGHT_LINE)
        unexplained = unexplained or not effects
    return effects, unexplained


def _least_mean(effect: Effect) -> float:
    """Mean advantage that an effect must have where much is left."""
    return MEAN_OF_A_LINE if effect.slug in STRAIGHT_LINE else MEAN_WHERE_MUCH_IS_LEFT


def _much_nearer(heldout: HeldOutFit) -> bool:
    """True where the free run on unseen samples loses a good part of its error, beyond chance."""
    if heldout.rmse_naive is None or heldout.rmse_extended is None or heldout.gain_low is None:
        return False
    return heldout.rmse_extended <= MUCH_NEARER * heldout.rmse_naive and heldout.gain_low > 0.0


def _of_air(effect: Effect) -> bool:
    """True for what shapes the command: friction or a force that wanders is not like it."""
    return catalogue()[effect.slug].acts_on is ActsOn.COMMAND


def _is_nearly_all(lines: Sequence[float], heldout: HeldOutFit) -> bool:
    """Whether the reading's line, the best of ``lines`` (mean advantages), leaves so little of what
    S and J alone leave that no bend can be a part of it. Each block counts 2 at most
    (``stickslip.advantage``), beside which a bend of some hundredths of a percent would be a
    part of a zero that is off by much."""
    before, after = heldout.rmse_naive, heldout.rmse_extended
    if max(lines) < AT_MOST or before is None or after is None:
        return False
    return after < LEAST_BEND * before


def _is_bent(evaluator: Evaluator, fitted: Fitted, mean_of_line: float) -> bool:
    """True where a straight line through the reading, which has this mean advantage, leaves a bend
    that is a part of it: without the line, S would have to make up for all of it.
    """
    bend = curvature(evaluator, fitted)
    is_seen = convincing(bend, evaluator.measured_counts, BEND)
    return is_seen and bend.mean >= LEAST_BEND * mean_of_line


def _refuted(heldout: HeldOutFit) -> bool:
    """True where the extended model, fitted to the first part, predicts the rest clearly worse."""
    if heldout.rmse_naive is None or heldout.rmse_extended is None or heldout.gain_high is None:
        return False
    return heldout.rmse_extended > WORSE * heldout.rmse_naive and heldout.gain_high < 0.0
