"""Every term on top of a hypothesis, each searched for, and by how much it lowers the loss on
blocks of time that were not fitted.

After a first look at all of them the best are searched with care. What a term seems to gain may
only be a search without it that has ended too soon, so the hypothesis without it is searched again
from where the best terms have ended.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from stemwatch.models.mismatch.fit.base_coordinate import S_and_J
from stemwatch.models.mismatch.fit.batched_search import Search, run_together
from stemwatch.models.mismatch.fit.crossfit import (
    CAREFUL,
    LOOK,
    POLISH,
    FitEffort,
    Fitted,
    better,
    from_best,
    gain,
    own_losses,
    ranked,
    refit,
    scored,
    widened,
)
from stemwatch.models.mismatch.fit.evaluator import Evaluator, TermSet
from stemwatch.models.mismatch.fit.starting_points import beginnings
from stemwatch.models.mismatch.search.named_terms import TermScore
from stemwatch.models.mismatch.search.other_coordinates import best_together, carried_over, without
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Floats

REFINED = 3  # candidates of a stage that are searched with care
PROMISING = 0.02  # mean advantage at the first look; less has never become a finding
ATTEMPTS = 2  # looks at the terms of a stage, each on a base that was restarted from the last
# Terms that are looked at again where the base has moved, the best of the look before.
LOOKED_AT_AGAIN = 7
MOVED = 0.03  # mean advantage of a restarted base over itself from which all is done again
PUT_BESIDE = 5  # terms that are put beside a hypothesis as they were fitted alone


def refined(
    evaluator: Evaluator, simple: Fitted, terms: Sequence[Term], effort: FitEffort = LOOK
) -> Search[tuple[Fitted, list[TermScore]]]:
    """All ``terms`` on top of ``simple``, the best of them searched with care, and ``simple``
    restarted from each of these.

    A local minimum of the simple hypothesis is the commonest cause of a false discovery: where a
    restart finds a better one, the whole stage is repeated from there.
    """
    to_look_at, scores = list(terms), list[TermScore]()
    for _ in range(ATTEMPTS):
        first_looks = yield from screened(evaluator, simple, to_look_at, effort)
        first_looks += scores[LOOKED_AT_AGAIN:]
        promising = [score for score in first_looks[:REFINED] if score.advantage.mean >= PROMISING]
        careful = yield from run_together(_careful(evaluator, score) for score in promising)
        scores = [*careful, *first_looks[len(promising) :]]
        restarted = yield from _restarted(evaluator, simple, scores[:REFINED])
        moved = gain(evaluator, simple, restarted).mean
        simple = restarted
        if moved < MOVED:
            break
        to_look_at = [score.term for score in scores[:LOOKED_AT_AGAIN]]
    nested = yield from run_together(_nested(evaluator, simple, score) for score in scores)
    return simple, _ordered(nested)


def screened(
    evaluator: Evaluator, simple: Fitted, terms: Iterable[Term], effort: FitEffort = LOOK
) -> Search[list[TermScore]]:
    """Every term on top of ``simple``, best first."""
    scores = yield from run_together(_looked_at(evaluator, simple, term, effort) for term in terms)
    return _ordered(scores)


def _looked_at(
    evaluator: Evaluator, simple: Fitted, term: Term, effort: FitEffort
) -> Search[TermScore]:
    """A first look at one term on top of ``simple``."""
    rich = simple.layout.hypothesis.plus(term)
    losses_of_simple = own_losses(evaluator, simple)
    starts, layout = _starts(evaluator, simple, term, rich), evaluator.layout(rich)
    begun = yield from ranked(evaluator, layout, starts, effort.keep + CAREFUL.keep - 1)
    fitted = yield from from_best(evaluator, layout, begun, effort, losses_of_simple)
    neutral_fit = yield from neutral(evaluator, simple, rich)
    fitted = better(evaluator, neutral_fit, fitted)
    further = tuple(
        np.vstack((even.candidate, odd.candidate))
        for even, odd in zip(*(best[effort.keep :] for best in begun), strict=True)
    )
    return TermScore(term, fitted, gain(evaluator, simple, fitted), further)


def _starts(evaluator: Evaluator, simple: Fitted, term: Term, rich: TermSet) -> Floats:
    """(m, size) where the search for one more term begins."""
    S, J = S_and_J(simple.candidates.mean(axis=0))
    return widened(evaluator, rich, simple, term, beginnings(term, S, J))


def neutral(evaluator: Evaluator, simple: Fitted, rich: TermSet) -> Search[Fitted]:
    """``simple`` written in the coordinates of ``rich``, its new terms neutral."""
    layout = evaluator.layout(rich)
    fitted = yield from scored(layout, carried_over(simple, layout))
    return fitted


def reduced(evaluator: Evaluator, rich: Fitted, simple: TermSet) -> Floats:
    """(2, size) the candidates of ``rich`` in the coordinates of ``simple``."""
    return carried_over(rich, evaluator.layout(simple))


def _careful(evaluator: Evaluator, score: TermScore) -> Search[TermScore]:
    """A score refined by a longer search: from the result of the first look, and from the starts
    that it did not use.
    """
    fitted = yield from refit(evaluator, score.fitted, CAREFUL, *score.further)
    return TermScore(score.term, fitted, score.advantage)


def _restarted(evaluator: Evaluator, simple: Fitted, scores: Sequence[TermScore]) -> Search[Fitted]:
    """``simple`` searched again from the results of richer hypotheses."""
    if not scores:
        return simple
    restarts = [start for score in scores for start in without(score.fitted, simple.layout)]
    fitted = yield from refit(evaluator, simple, CAREFUL, *restarts)
    fitted = yield from refit(evaluator, fitted, POLISH)
    return fitted


def _nested(evaluator: Evaluator, simple: Fitted, score: TermScore) -> Search[TermScore]:
    """A score against the refined ``simple``, which the richer hypothesis contains."""
    neutral_fit = yield from neutral(evaluator, simple, score.fitted.layout.hypothesis)
    fitted = better(evaluator, neutral_fit, score.fitted)
    return TermScore(score.term, fitted, gain(evaluator, simple, fitted))


def put_beside(
    evaluator: Evaluator,
    simple: Fitted,
    scores: Sequence[TermScore],
    alone: Sequence[TermScore],
) -> Search[list[TermScore]]:
    """The ``scores`` of terms on top of ``simple``, the best of them searched again from where
    ``simple`` and the fits of the terms ``alone`` are put together.

    Searched on top of ``simple``, a term ends where that was, which has taken its part as well.
    """
    known = {score.slug: score for score in scores}
    others = [score for score in alone if score.slug in known and score.advantage.mean >= PROMISING]
    found = yield from run_together(
        _beside(evaluator, simple, score) for score in others[:PUT_BESIDE]
    )
    better_ones = {
        score.slug: score
        for score in found
        if score.advantage.mean > known[score.slug].advantage.mean
    }
    return _ordered((known | better_ones).values())


def _beside(evaluator: Evaluator, simple: Fitted, alone: TermScore) -> Search[TermScore]:
    """A term beside ``simple``, searched from where both are put together."""
    layout = evaluator.layout(simple.layout.hypothesis.plus(alone.term))
    begun = yield from best_together(evaluator, layout, (simple, alone.fitted), LOOK.keep)
    fitted = yield from from_best(evaluator, layout, begun, LOOK, own_losses(evaluator, simple))
    return TermScore(alone.term, fitted, gain(evaluator, simple, fitted))


def _ordered(scores: Iterable[TermScore]) -> list[TermScore]:
    return sorted(scores, key=lambda score: -score.advantage.mean)
