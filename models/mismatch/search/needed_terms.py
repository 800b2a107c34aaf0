"""Which of the terms that were found one after the other are still needed beside each other: the
first of two has often stood in for both.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from stemwatch.models.mismatch.acceptance_limits import convincing
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import CAREFUL, POLISH, Fitted, gain, refit, scored
from stemwatch.models.mismatch.fit.evaluator import Evaluator, TermSet
from stemwatch.models.mismatch.search.named_terms import (
    Named,
    Needed,
    SelectionStage,
    beside_another,
)
from stemwatch.models.mismatch.search.other_coordinates import carried_over, in_bounds_of, without
from stemwatch.models.stickslip.advantage import Advantage


def pruned(
    evaluator: Evaluator, fitted: Fitted, stages: list[SelectionStage]
) -> tuple[Fitted, list[Needed]]:
    """Drop each term, in the order in which they were found, that is not needed any more beside the
    later ones.

    The first term of two has often stood in for both.
    """
    if len(stages) == 1:
        return _only_if_needed(evaluator, fitted, stages[0])
    needed: list[Needed] = []
    for number, stage in enumerate(stages):
        beside = number < 2 and beside_another(stages[:1])
        fewer = fitted.layout.hypothesis.without(stage.accepted[0].slug)
        without_term = _refitted_with(evaluator, fitted, fewer, _known(stages, fewer))
        advantage = gain(evaluator, without_term, fitted)
        if _is_needed(evaluator, fitted, stage, advantage, 1, beside):
            needed.append(Needed(stage, without_term, advantage))
        else:
            fitted = without_term
    if len(needed) == 1:
        return pruned(evaluator, fitted, [needed[0].stage])
    return fitted, needed


def lacking(named: Named, slugs: Collection[str]) -> Named:
    """What was named without some terms, refitted, and what is still needed of the others."""
    stages = [needed.stage for needed in named.needed if needed.term.slug not in slugs]
    if len(stages) == len(named.needed):
        return named
    if not stages:
        return replace(named, fitted=named.base, needed=())
    remaining = TermSet(
        tuple(term for term in named.fitted.layout.hypothesis.terms if term.slug not in slugs)
    )
    evaluator = named.evaluator
    kept = tuple(needed for needed in named.needed if needed.term.slug not in slugs)
    if any(needed.likelihood is not None for needed in kept):
        # Trajectories have not shown it, and decide neither its size nor whether it is needed.
        fitted = _still_held(named, remaining)
        return replace(named, fitted=fitted, needed=kept)
    fitted = _refitted_with(evaluator, named.fitted, remaining)
    if len(stages) == 1:
        # Its own stage may have had a term before it that is gone now.
        stages = [replace(stages[0], before=named.base)]
    fitted, needed = pruned(evaluator, fitted, stages)
    return replace(named, fitted=fitted, needed=tuple(needed))


def _still_held(named: Named, remaining: TermSet) -> Fitted:
    """The fit to no more than the ``remaining`` terms that leaves S, J and sizes where they are
    held: as it was before the last one was named, or the one of now without the others.
    """
    evaluator, before = named.evaluator, named.needed[-1].without
    if set(before.slugs) == set(remaining.slugs):
        return before
    layout = in_bounds_of(evaluator.layout(remaining), named.fitted.layout)
    start = conclude(evaluator, scored(layout, carried_over(named.fitted, layout)))
    return conclude(evaluator, refit(evaluator, start, POLISH))


def _only_if_needed(
    evaluator: Evaluator, fitted: Fitted, stage: SelectionStage
) -> tuple[Fitted, list[Needed]]:
    """``fitted``, which has the term of one stage alone, or what stood before where it is not
    needed.
    """
    before = stage.before
    if before.layout.hypothesis.terms:
        # It was found behind a term that has been dropped since.
        before = _refitted_with(evaluator, fitted, TermSet())
    advantage = gain(evaluator, before, fitted)
    if _is_needed(evaluator, fitted, stage, advantage):
        return fitted, [Needed(stage, before, advantage)]
    # What was polished on both folds predicts less than it did at its first look, or was taken for
    # the sake of a second term that was not found.
    return before, []


def _known(stages: Sequence[SelectionStage], terms: TermSet) -> list[Fitted]:
    """The fits of a hypothesis with just these ``terms`` that the search has come by."""
    fits = [fit for stage in stages for fit in (stage.before, *(s.fitted for s in stage.scores))]
    return [fit for fit in fits if fit.slugs == terms.slugs]


def _refitted_with(
    evaluator: Evaluator, fitted: Fitted, terms: TermSet, known: Sequence[Fitted] = ()
) -> Fitted:
    """``fitted`` with no more than some of its ``terms``, searched anew, also from fits that are
    ``known`` of these: what a term has taken over from them is not found again beside it."""
    layout = evaluator.layout(terms)
    first, *more = without(fitted, layout)
    more += [layout.bounds.clip(fit.candidates) for fit in known]
    start = conclude(evaluator, scored(layout, first))
    return conclude(evaluator, refit(evaluator, start, CAREFUL, *more))


def _is_needed(
    evaluator: Evaluator,
    fitted: Fitted,
    stage: SelectionStage,
    advantage: Advantage,
    number: int = 0,
    beside: bool = False,
) -> bool:
    """True where the hypothesis gains by the term of a stage beyond what chance reaches in round
    ``number``, ``beside`` as of ``convincing``; where that was only promising, and has passed no
    test of its size, its size must be material as well.
    """
    term = stage.accepted[0].term
    if not convincing(advantage, evaluator.measured_counts, term.slug, number, beside):
        return False
    values = fitted.values(term.slug).mean(axis=0)
    return not stage.promising or term.material(values, evaluator.summary)
