"""Which terms explain what S, J and the reading leave, found one after the other.

A term enters a hypothesis where it improves the prediction of blocks of time that it was not fitted
to by more than recordings with nothing hidden show (``acceptance_limits``), and where its size is
material. The simpler of two equally good terms is taken. Then the next one is looked for on top of
it, three at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stemwatch.models.mismatch.acceptance_limits import not_little_left, something_left
from stemwatch.models.mismatch.fit.base_fit import AGAIN, BaseFit, sticking_again
from stemwatch.models.mismatch.fit.batched_search import Search, conclude
from stemwatch.models.mismatch.fit.crossfit import GLANCE, LOOK, POLISH, Fitted, gain, refit
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.search.breakaway_levels import PLAY
from stemwatch.models.mismatch.search.explaining_terms import (
    AS_GOOD,
    NEARLY,
    accepted,
    jump_is_visible,
    passes,
)
from stemwatch.models.mismatch.search.named_by_breakaways import named_by_breakaways
from stemwatch.models.mismatch.search.named_terms import Named, SelectionStage, beside_another
from stemwatch.models.mismatch.search.needed_terms import pruned
from stemwatch.models.mismatch.search.term_scores import PROMISING, put_beside, refined
from stemwatch.models.mismatch.term import Term

MOST_TERMS = 3


def name_terms(base: BaseFit, terms: Sequence[Term]) -> Named:
    """Build the hypothesis up from the base with the ``terms`` that the recording can show.

    Where a stem that sticks again fits clearly better than the base, both are built up, for a dead
    time or a lag looks like such a stem at first; the latter is taken where it predicts unseen
    blocks better beyond chance, or with fewer terms.
    """
    named = _named_from(base, terms)
    if base.sticks_again is None:
        return named
    again = _named_from(base.sticks_again, terms)
    nearer = gain(base.evaluator, named.fitted, again.fitted)
    simpler = len(again.needed) < len(named.needed) and nearer.mean > 0.0
    return again if simpler or nearer.t >= AS_GOOD else named


def _named_from(base: BaseFit, terms: Sequence[Term]) -> Named:
    """The hypothesis that is reached from the fit of one base."""
    evaluator, simple = base.evaluator, base.fitted
    terms_left = list(terms)
    stages: list[SelectionStage] = []
    while len(stages) < MOST_TERMS:
        stage = _stage(evaluator, simple, terms_left, stages)
        stages.append(stage)
        simple = stage.before
        if not stage.accepted:
            break
        chosen = stage.accepted[0]
        simple = conclude(evaluator, refit(evaluator, chosen.fitted, POLISH))
        terms_left = [term for term in terms_left if term.slug != chosen.slug]
        if _is_weak_second(evaluator, stages):
            break  # nothing is built on it
    simple = conclude(evaluator, _sticking_again(evaluator, simple))
    fitted, needed = pruned(evaluator, simple, [stage for stage in stages if stage.accepted])
    if len(needed) < 2 and _is_weak_second(evaluator, stages):
        stages[-1] = replace(stages[-1], accepted=())
        fitted, needed = pruned(evaluator, stages[-1].before, stages[:1])
    has_play = any(term_needed.term.slug == PLAY for term_needed in needed)
    if has_play and not jump_is_visible(fitted, evaluator):
        # A later term has taken away the jump that separated play from friction.
        return _named_from(base, [term for term in terms if term.slug != PLAY])
    if not needed:
        fitted, needed = named_by_breakaways(evaluator, fitted, terms)
    return Named(
        evaluator=evaluator,
        base=stages[0].before,
        fitted=fitted,
        needed=tuple(needed),
        stages=tuple(stages),
    )


def _stage(
    evaluator: Evaluator,
    simple: Fitted,
    terms: Sequence[Term],
    stages: Sequence[SelectionStage],
) -> SelectionStage:
    """The round after ``stages``: one more of ``terms`` on top of ``simple``."""
    number = len(stages)
    effort, beside = GLANCE if stages else LOOK, beside_another(stages)
    before, scores = conclude(evaluator, refined(evaluator, simple, terms, effort))
    explaining = accepted(evaluator, scores, number, beside)
    if stages and not explaining:
        scores = conclude(evaluator, put_beside(evaluator, before, scores, stages[0].scores))
        explaining = accepted(evaluator, scores, number, beside)
    look_for_two = not explaining and number == 0 and not_little_left(evaluator, before)
    if not look_for_two:
        return SelectionStage(before, tuple(scores), tuple(explaining))
    # Two terms that explain it together may gain nothing one by one; whether both are needed is
    # tested at the end.
    best_guess = [score for score in scores[:1] if score.advantage.mean >= PROMISING]
    return SelectionStage(before, tuple(scores), tuple(best_guess), promising=True)


def _is_weak_second(evaluator: Evaluator, stages: Sequence[SelectionStage]) -> bool:
    """True where the last of ``stages`` brought a second term that is below the limits of one
    beside any other."""
    if not beside_another(stages[:-1]) or not stages[-1].accepted:
        return False
    return not passes(stages[-1].accepted[0], evaluator, len(stages) - 1)


def _sticking_again(evaluator: Evaluator, fitted: Fitted) -> Search[Fitted]:
    """A hypothesis with terms, or the same of a stem that sticks again where that is clearly
    better.

    No descent from a stem that slides finds such a one, and the base did not show it where a term
    has taken the largest part of what was left. It is looked for last, for what lacks a lag or a
    delay looks like it.
    """
    if not fitted.slugs or not something_left(evaluator, fitted):
        return fitted
    variants = sticking_again(fitted.layout, fitted.candidates)
    again = yield from refit(evaluator, fitted, AGAIN, *variants)
    more = gain(evaluator, fitted, again)
    return again if more.mean >= NEARLY and more.t >= AS_GOOD else fitted
