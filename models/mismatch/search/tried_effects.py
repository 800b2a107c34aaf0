"""The scores of every effect that was tried in the rounds of the search.

For the page: its gain alone and beside what is named, and why it is not named (``TriedEffect``).
For other windows of the valve: its gain where it was looked at last (``EffectScore``), which is
there for a drive too, and small enough to be kept for months.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from stemwatch.models.mismatch.acceptance_limits import convincing, strength
from stemwatch.models.mismatch.findings import Effect, EffectScore, Gain, TriedEffect, TriedOutcome
from stemwatch.models.mismatch.fit.crossfit import gain
from stemwatch.models.mismatch.search.drive import TERMS as OF_A_DRIVE
from stemwatch.models.mismatch.search.named_terms import Named, SelectionStage, TermScore
from stemwatch.models.stickslip.advantage import Advantage


def what_was_tried(
    named: Named, effects: Iterable[Effect], too_small: Collection[str] = ()
) -> tuple[tuple[TriedEffect, ...], Gain | None]:
    """Every term tried alone over S and J, the largest gain first, and the gain of all named terms
    together; empty for a drive, whose motor and load are one model. ``too_small`` are slugs that
    stand and are not named, because they need no work.
    """
    slugs = {effect.slug for effect in effects}
    same_class = {slug for effect in effects for slug in effect.members} - slugs
    if not named.stages or slugs & set(OF_A_DRIVE):
        return (), None
    on_top = _on_top(named)
    tried_list = []
    for score in named.stages[0].scores:
        beside_score = None if score.slug in slugs else on_top.get(score.slug)
        outcome = (
            TriedOutcome.NAMED
            if score.slug in slugs
            else TriedOutcome.AS_GOOD
            if score.slug in same_class
            else TriedOutcome.TOO_SMALL
            if score.slug in too_small
            else _rejected(named, score, beside_score)
        )
        tried_list.append(
            TriedEffect(
                slug=score.slug,
                alone=_gain(score.advantage),
                beside=None if beside_score is None else _gain(beside_score.advantage),
                outcome=outcome,
            )
        )
    # The reading's own errors are free in every hypothesis, so that what all gain together over a
    # reading without them was never tried.
    of_terms = bool(slugs) and slugs <= {effect_tried.slug for effect_tried in tried_list}
    combined_gain = gain(named.evaluator, named.base, named.fitted) if of_terms else None
    return tuple(tried_list), None if combined_gain is None else _gain(combined_gain)


def _gain(advantage: Advantage) -> Gain:
    return Gain(mean=float(advantage.mean), t=float(advantage.t))


def _on_top(named: Named) -> dict[str, TermScore]:
    """The scores of the round that began with exactly the named terms, if there was one."""
    final = set(named.fitted.layout.hypothesis.slugs)

    def begins_there(stage: SelectionStage) -> bool:
        return set(stage.before.layout.hypothesis.slugs) == final

    last = next((stage for stage in named.stages[1:] if begins_there(stage)), None)
    return {} if last is None else {score.slug: score for score in last.scores}


def _rejected(named: Named, score: TermScore, beside_score: TermScore | None) -> TriedOutcome:
    """Why a term that was tried is not named."""
    informative, summary = named.evaluator.measured_counts, named.evaluator.summary
    if not convincing(score.advantage, informative, score.slug):
        return TriedOutcome.CHANCE
    # A gain that what is named makes as well says nothing about the size of this one.
    if beside_score is not None and not convincing(
        beside_score.advantage, informative, beside_score.slug, 1
    ):
        return TriedOutcome.ADDS_NOTHING
    if not score.term.material(score.values, summary):
        return TriedOutcome.TOO_SMALL
    if beside_score is None:
        return TriedOutcome.NOT_HELD
    return (
        TriedOutcome.NOT_HELD
        if beside_score.term.material(beside_score.values, summary)
        else TriedOutcome.TOO_SMALL
    )


def scores_of(named: Named, effects: tuple[Effect, ...]) -> tuple[EffectScore, ...]:
    """Every term that was looked at: those that stand by their evidence, the others by what they
    gained on top of the terms before them, where they were looked at last."""
    counts = named.evaluator.measured_counts
    score_of: dict[str, EffectScore] = {}
    for round_number, stage in enumerate(named.stages):
        for score in stage.scores:
            mean, t = score.advantage.mean, score.advantage.t
            beyond_limits = strength(score.advantage, counts, score.slug, round_number)
            score_of[score.slug] = EffectScore(
                slug=score.slug, mean=mean, t=t, strength=beyond_limits
            )
    for effect in effects:
        evidence = effect.evidence
        score_of[effect.slug] = EffectScore(
            slug=effect.slug, mean=evidence.mean, t=evidence.t, strength=evidence.strength
        )
    return tuple(score_of[slug] for slug in sorted(score_of))
