"""What chance alone reaches on a recording in which nothing is hidden: the scores from which limits
are calibrated (``stemwatch calibrate-mismatch``).
"""

from __future__ import annotations

from dataclasses import dataclass

from stemwatch.models.mismatch.acceptance_limits import (
    noise_share,
    remaining_loss,
    short_record_factor,
    strength,
)
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import admissible, prepare, problem_of, why_not
from stemwatch.models.mismatch.search.drive import of_the_valve
from stemwatch.models.mismatch.search.named_by_likelihood import strongest_by_likelihood
from stemwatch.models.mismatch.search.named_terms import TermScore
from stemwatch.models.mismatch.search.needed_terms import lacking
from stemwatch.models.mismatch.search.term_pairs import strongest_pair
from stemwatch.models.mismatch.search.term_selection import name_terms
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import Recording


@dataclass(frozen=True)
class NullScores:
    """What chance alone reaches on one recording in which nothing is hidden.

    ``terms``: mean, t and strength of the advantage of every admissible term over the base alone;
    ``pair``: the strength of the weaker of two beside the other, of the pair in which it is
    largest, 0 where no pair was worth a look. ``left``: what S and J leave in the worst tenth of
    the blocks, in noise variances, over the square of what a short record allows; ``noise`` is a
    share of the breakaway level. ``likelihood``: the strength of the strongest term by the
    likelihood of the whole record.
    """

    terms: dict[str, tuple[float, float, float]]
    pair: float
    left: float = 0.0
    noise: float = 0.0
    likelihood: float = 0.0


def null_scores(recording: Recording) -> NullScores:
    """The scores of one recording in which nothing is hidden, from which limits are calibrated; no
    terms where nothing can be fitted.
    """
    recording = on_own_clock(recording)
    measured = measured_record(recording)
    if why_not(recording, measured) is not None:
        return NullScores({}, 0.0)
    case = prepare(recording, measured, None, problem_of(recording, measured))
    terms = of_the_valve(admissible(case.refused))
    named = name_terms(case.base, terms)
    evaluator, counts = named.evaluator, named.evaluator.measured_counts
    first: tuple[TermScore, ...] = named.stages[0].scores
    return NullScores(
        terms={
            score.slug: (
                score.advantage.mean,
                score.advantage.t,
                strength(score.advantage, counts, score.slug),
            )
            for score in first
        },
        pair=strongest_pair(named, terms),
        left=remaining_loss(evaluator, named.base) / short_record_factor(counts) ** 2,
        noise=noise_share(evaluator, named.base),
        likelihood=strongest_by_likelihood(lacking(named, catalogue()), terms),
    )
