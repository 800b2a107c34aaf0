"""Two terms at once, where neither shows alone or one has stood in for both.

    the best of the first looks -> every other term on top of each
        -> the best pairs searched with care -> is each of the two needed beside the other?

Terms that are tried one by one are scored against a base that the missing other term has biased: a
pair may predict unseen blocks far better while each alone gains nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from stemwatch.models.mismatch.acceptance_limits import (
    LEAST_OF_A_PAIR,
    NEAR,
    something_left,
    strength,
)
from stemwatch.models.mismatch.fit.batched_search import Search, conclude, run_together
from stemwatch.models.mismatch.fit.crossfit import (
    CAREFUL,
    GLANCE,
    POLISH,
    Fitted,
    better,
    gain,
    refit,
    scored,
)
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.search.breakaway_levels import PLAY
from stemwatch.models.mismatch.search.explaining_terms import AS_GOOD, NEARLY, jump_is_visible
from stemwatch.models.mismatch.search.named_terms import Named, Needed, SelectionStage, TermScore
from stemwatch.models.mismatch.search.term_scores import PROMISING, reduced, screened
from stemwatch.models.mismatch.term import Term

BEGUN = 6  # terms that every other one is tried beside
SEARCHED = 5  # pairs that are searched with care


@dataclass(frozen=True)
class TermPair:
    """Two terms on top of the base, each scored against the best fit of the other alone."""

    fitted: Fitted
    scores: tuple[TermScore, TermScore]
    alone: tuple[Fitted, Fitted]  # without the first, and without the second

    @property
    def slugs(self) -> tuple[str, ...]:
        """The slugs of both terms, in the order in which they were searched."""
        return tuple(score.slug for score in self.scores)

    def least_strength(self, evaluator: Evaluator) -> float:
        """How far the weaker of the two lies beyond the limits of a term beside another."""
        told = evaluator.measured_counts
        return min(strength(score.advantage, told, score.slug, 1) for score in self.scores)

    def needs_both(self, evaluator: Evaluator) -> bool:
        """True where each term beside the other improves the prediction of unseen blocks by more
        than pairs do where nothing is hidden, and is of a material size.
        """
        return self.least_strength(evaluator) >= LEAST_OF_A_PAIR and self.of_some_size(evaluator)

    def of_some_size(self, evaluator: Evaluator) -> bool:
        """True where both are of a material size."""
        return all(
            (score.slug != PLAY or jump_is_visible(score.fitted, evaluator))
            and score.term.material(score.values, evaluator.summary)
            for score in self.scores
        )


def with_pair(named: Named, terms: Sequence[Term]) -> Named:
    """``named``, or a pair of ``terms`` that explains more, each needed beside the other.

    Looked for where at most one term was named and something else came near its limits.
    """
    if not _comes_near(named) or _noise_is_left(named):
        return named
    evaluator = named.evaluator
    standing = [
        pair
        for pair in best_pairs(named, terms)
        if pair.needs_both(evaluator) and _explains_more(evaluator, named, pair)
    ]
    if not standing:
        return named
    best = _simplest(evaluator, standing)
    polished = conclude(evaluator, refit(evaluator, best.fitted, POLISH))
    first, second = (score.term for score in best.scores)
    best = _pair(evaluator, polished, (first, second), best.alone)
    stages = [
        SelectionStage(without, (score,), (score, *_rivals(evaluator, standing, best, score)))
        for score, without in zip(best.scores, best.alone, strict=True)
    ]
    return replace(
        named,
        fitted=polished,
        needed=tuple(
            Needed(stage, stage.before, stage.scores[0].advantage, of_pair=True) for stage in stages
        ),
        stages=(*named.stages, *stages),
    )


def strongest_pair(named: Named, terms: Sequence[Term]) -> float:
    """The strength of the weaker of two beside the other, of the pair in which it is largest and
    both are of a size that matters; 0 where no pair is worth a look."""
    if not _comes_near(named) or _noise_is_left(named):
        return 0.0
    evaluator = named.evaluator
    strengths = (
        pair.least_strength(evaluator)
        for pair in best_pairs(named, terms)
        if pair.of_some_size(evaluator)
    )
    return max(strengths, default=0.0)


def _comes_near(named: Named) -> bool:
    """True where a term that is not named came near its limits, or was only lost at the end."""
    if len(named.needed) > 1:
        return False
    needed = {item.term.slug for item in named.needed}
    taken = {stage.accepted[0].slug for stage in named.stages if stage.accepted}
    if needed and taken - needed:
        return True
    number = len(named.stages) - 1 if needed else 0
    return any(
        strength(score.advantage, named.evaluator.measured_counts, score.slug, number) >= NEAR
        for score in named.stages[number].scores
        if score.slug not in needed
    )


def _noise_is_left(named: Named) -> bool:
    """True where nothing is named, and S and J alone leave hardly more than noise and scatter."""
    return not named.needed and not something_left(named.evaluator, named.fitted)


def best_pairs(named: Named, terms: Sequence[Term]) -> list[TermPair]:
    """The pairs of ``terms`` that gain most over the base, searched with care, the best first."""
    evaluator = named.evaluator
    alone = {score.slug: score.fitted for score in named.stages[0].scores}
    if len(named.fitted.slugs) == 1:
        alone[named.fitted.slugs[0]] = named.fitted
    looked_at = _most_gaining(evaluator, named.base, _looked(named, terms))
    searches = [_searched(evaluator, alone, *pair) for pair in looked_at]
    found: list[TermPair] = conclude(evaluator, run_together(searches))
    return sorted(found, key=lambda pair: -gain(evaluator, named.base, pair.fitted).mean)


def _looked(named: Named, terms: Sequence[Term]) -> dict[str, list[TermScore]]:
    """The scores of all others on top of the best of the first looks, by the slug of the latter."""
    scores = {score.slug: score for score in named.stages[0].scores}
    below = [score for score in scores.values() if score.advantage.mean >= PROMISING][:BEGUN]
    looks = [
        screened(
            named.evaluator,
            score.fitted,
            [term for term in terms if term.slug != score.slug and term.slug in scores],
            GLANCE,
        )
        for score in below
    ]
    found = conclude(named.evaluator, run_together(looks))
    return {score.slug: beside for score, beside in zip(below, found, strict=True)}


def _most_gaining(
    evaluator: Evaluator, base: Fitted, beside: dict[str, list[TermScore]]
) -> list[tuple[str, TermScore]]:
    """The pairs that gain most over the base: the term below, and the other's score on top."""
    gained: dict[frozenset[str], tuple[float, str, TermScore]] = {}
    for slug, scores in beside.items():
        for score in scores:
            mean = gain(evaluator, base, score.fitted).mean
            pair = frozenset((slug, score.slug))
            if pair not in gained or mean > gained[pair][0]:
                gained[pair] = (mean, slug, score)
    ordered = sorted(gained.values(), key=lambda item: -item[0])
    return [(slug, score) for _, slug, score in ordered[:SEARCHED]]


def _searched(
    evaluator: Evaluator, alone: dict[str, Fitted], below: str, on_top: TermScore
) -> Search[TermPair]:
    """A pair searched with care, and each of its terms alone, begun from the pair as well."""
    fitted = yield from refit(evaluator, on_top.fitted, CAREFUL)
    (term,) = (term for term in fitted.layout.hypothesis.terms if term.slug == below)
    without_first, without_second = yield from run_together(
        _alone(evaluator, fitted, alone[slug]) for slug in (on_top.slug, below)
    )
    return _pair(evaluator, fitted, (term, on_top.term), (without_first, without_second))


def _alone(evaluator: Evaluator, fitted: Fitted, known: Fitted) -> Search[Fitted]:
    """The better of the ``known`` fit of one term alone and the fit that starts from the pair."""
    (gone,) = set(fitted.slugs) - set(known.slugs)
    start = yield from _less(evaluator, fitted, gone)
    again = yield from refit(evaluator, start, CAREFUL)
    return better(evaluator, known, again)


def _less(evaluator: Evaluator, fitted: Fitted, slug: str) -> Search[Fitted]:
    """``fitted`` without one of its terms, all else as it is."""
    layout = evaluator.layout(fitted.layout.hypothesis.without(slug))
    less = yield from scored(layout, reduced(evaluator, fitted, layout.hypothesis))
    return less


def _pair(
    evaluator: Evaluator,
    fitted: Fitted,
    terms: tuple[Term, Term],
    alone: tuple[Fitted, Fitted],
) -> TermPair:
    """A pair as it is ``fitted``."""
    first, second = (
        TermScore(term, fitted, gain(evaluator, without, fitted))
        for term, without in zip(terms, alone, strict=True)
    )
    return TermPair(fitted, (first, second), alone)


def _explains_more(evaluator: Evaluator, named: Named, pair: TermPair) -> bool:
    """True where the pair is clearly better than what was named, or holds it."""
    if set(named.fitted.slugs) <= set(pair.slugs):
        return True  # each is needed beside the other
    more = gain(evaluator, named.fitted, pair.fitted)
    return more.mean >= NEARLY and more.t >= AS_GOOD


def _simplest(evaluator: Evaluator, pairs: Sequence[TermPair]) -> TermPair:
    """The best pair, or one nearly as good of which a term is a special case of its own."""
    best = pairs[0]
    for pair in pairs[1:]:
        more = gain(evaluator, pair.fitted, best.fitted)
        if _contained(best, pair) and (more.mean < NEARLY or more.t < 1.0):
            best = pair
    return best


def _contained(rich: TermPair, simple: TermPair) -> bool:
    """True where the pairs share a term, and the other is a special case of the richer pair's."""
    of_rich = [score.term for score in rich.scores if score.slug not in simple.slugs]
    of_simple = [score.slug for score in simple.scores if score.slug not in rich.slugs]
    return len(of_rich) == 1 and of_simple[0] in of_rich[0].contains


def _rivals(
    evaluator: Evaluator, pairs: Sequence[TermPair], best: TermPair, score: TermScore
) -> list[TermScore]:
    """What explains as much in the place of one of the best pair's terms."""
    (other,) = (slug for slug in best.slugs if slug != score.slug)
    return [
        rival
        for pair in pairs
        if other in pair.slugs and score.slug not in pair.slugs
        for rival in pair.scores
        if rival.slug != other and gain(evaluator, pair.fitted, best.fitted).t < AS_GOOD
    ]
