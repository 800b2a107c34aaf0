"""A hypothesis with a term that the likelihood has shown: S, J and its size are held near the most
likely ones, for trajectories would trade them for each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stemwatch.models.mismatch.fit.base_coordinate import RATIO, S_PERCENT
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import Fitted, gain, on_both, scored
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout, Evaluator
from stemwatch.models.mismatch.likelihood.likelihood_evidence import LikelihoodEvidence
from stemwatch.models.mismatch.likelihood.maximum_likelihood import Likeliest, RecordLikelihood
from stemwatch.models.mismatch.search.breakaway_scatter import ALL_OVER
from stemwatch.models.mismatch.search.compared_by_likelihood import Compared
from stemwatch.models.mismatch.search.named_terms import Named, Needed, SelectionStage, TermScore
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.parameters import Bounds

CONTRADICTED = -1.0  # t of the trajectories, below which they speak against a term
HELD_WITHIN, LEAST_WITHIN = 2.0, 0.02  # standard errors; share of S, of J/S and of a size


def named_with(
    likelihood: RecordLikelihood,
    named: Named,
    members: Sequence[Compared],
    evidence: LikelihoodEvidence,
) -> Named:
    """``named`` with one more term for which there is ``evidence``, unless trajectories contradict
    it; ``members`` are those that the record does not tell apart.
    """
    evaluator, best = named.evaluator, members[0]
    places = best.rich.layout.places[best.term.slug]
    layout = held(likelihood, best.rich, (S_PERCENT, RATIO, *range(places.start, places.stop)))
    fitted = scored_at(evaluator, layout, best.rich.candidate)
    scores = []
    for one in members:
        of_term = (
            fitted if one is best else scored_at(evaluator, one.rich.layout, one.rich.candidate)
        )
        scores.append(TermScore(one.term, of_term, gain(evaluator, named.fitted, of_term)))
    against = scores[0].advantage.t < CONTRADICTED
    if against and len(named.needed) <= 1:
        # They are scored at the most likely parameters without the term as well: those that were
        # fitted to them are nearer anyhow. Beside two effects, a third one was wrong then.
        simple = scored_at(evaluator, best.simple.layout, best.simple.candidate)
        against = gain(evaluator, simple, fitted).t < CONTRADICTED
    if against and evidence.t < ALL_OVER:
        return named
    stage = SelectionStage(named.fitted, tuple(scores), tuple(scores))
    needed = Needed(stage, named.fitted, scores[0].advantage, likelihood=evidence)
    return replace(named, fitted=fitted, needed=(*named.needed, needed))


def held(
    likelihood: RecordLikelihood, at: Likeliest, coordinates: Sequence[int]
) -> CoordinateLayout:
    """The layout of a point with some coordinates, such as S, J and the size of a term, held near
    to it: trajectories would trade them for each other.
    """
    layout, low, high = at.layout, at.layout.bounds.low.copy(), at.layout.bounds.high.copy()
    errors = likelihood.standard_errors(at)
    for place in coordinates:
        value = at.candidate[place]
        within = max(HELD_WITHIN * errors[place], LEAST_WITHIN * abs(value))
        low[place] = max(low[place], value - within)
        high[place] = min(high[place], value + within)
    return replace(layout, bounds=Bounds(low, high))


def scored_at(evaluator: Evaluator, layout: CoordinateLayout, candidate: Floats) -> Fitted:
    """A candidate as the fit to both folds, with its losses."""
    return conclude(evaluator, scored(layout, on_both(layout, candidate).candidates))
