"""Which terms explain a recording, by their scores: those that gain more than recordings with
nothing hidden show and whose size is material, the simpler of two that are equally good first.
"""

from __future__ import annotations

from stemwatch.models.mismatch.acceptance_limits import convincing
from stemwatch.models.mismatch.fit.base_coordinate import S_and_J
from stemwatch.models.mismatch.fit.crossfit import Fitted, gain
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.search.breakaway_levels import PLAY
from stemwatch.models.mismatch.search.named_terms import TermScore

LEAST_JUMP_SHARE, LEAST_JUMP_PERCENT = 0.15, 0.3  # of S and play; of travel; less is not visible
AS_GOOD = 1.5  # paired t below which two explanations cannot be separated
NEARLY = 0.03  # mean advantage that a richer term must have over a simpler one that it contains


def accepted(
    evaluator: Evaluator, scores: list[TermScore], stage: int, beside: bool = False
) -> list[TermScore]:
    """The terms that explain the recording: first the one to take, then those that are as good."""
    passing = [score for score in scores if passes(score, evaluator, stage, beside)]
    if not passing:
        return []
    best = passing[0]
    for simpler in passing[1:]:
        if simpler.slug in best.term.contains and _nearly(evaluator, simpler, best):
            best = simpler
            break
    rivals = [score for score in passing if score is not best and _as_good(evaluator, score, best)]
    # A second lag on top of a lag is what another delay looks like.
    unrelated = next((score for score in rivals if not _related(score)), None)
    if unrelated is not None and _related(best):
        return [unrelated, *(score for score in (best, *rivals) if score is not unrelated)]
    return [best, *rivals]


def passes(score: TermScore, evaluator: Evaluator, stage: int, beside: bool = False) -> bool:
    """True where the gain is larger than recordings with nothing hidden show, and the size is
    material; ``beside`` as of ``convincing``.
    """
    counts = evaluator.measured_counts
    is_convincing = convincing(score.advantage, counts, score.slug, stage, beside)
    return (
        is_convincing
        and (score.slug != PLAY or jump_is_visible(score.fitted, evaluator))
        and score.term.material(score.values, evaluator.summary)
    )


def jump_is_visible(fitted: Fitted, evaluator: Evaluator) -> bool:
    """False for a stem that hardly jumps: then play and friction make one dead band, and cannot be
    separated.
    """
    S, J = S_and_J(fitted.candidates.mean(axis=0))
    dead_band = S + float(fitted.values(PLAY).mean())
    return bool(
        J >= max(LEAST_JUMP_SHARE * dead_band, 4.0 * evaluator.summary.sigma, LEAST_JUMP_PERCENT)
    )


def _related(score: TermScore) -> bool:
    """True where the term contains one that stands before it, or is contained in one."""
    terms = [term for term in score.fitted.layout.hypothesis.terms if term.slug != score.slug]
    return any(term.slug in score.term.contains or score.slug in term.contains for term in terms)


def _nearly(evaluator: Evaluator, simple: TermScore, rich: TermScore) -> bool:
    """True where the richer term is not clearly better than the simpler one that it contains."""
    gain_of_both = gain(evaluator, simple.fitted, rich.fitted)
    return gain_of_both.mean < NEARLY or gain_of_both.t < 1.0


def _as_good(evaluator: Evaluator, rival: TermScore, best: TermScore) -> bool:
    return gain(evaluator, rival.fitted, best.fitted).t < AS_GOOD
