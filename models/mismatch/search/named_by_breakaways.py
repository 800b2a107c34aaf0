"""Dwell or play, where the breakaways together show it although no trajectory needs a term."""

from __future__ import annotations

from collections.abc import Sequence

from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import Fitted, gain
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.search.breakaway_levels import (
    LEAST_T,
    BreakawayEvidence,
    breakaway_evidence,
    refit_with_size,
)
from stemwatch.models.mismatch.search.named_terms import Needed, SelectionStage, TermScore
from stemwatch.models.mismatch.search.term_scores import neutral
from stemwatch.models.mismatch.term import Term


def named_by_breakaways(
    evaluator: Evaluator, simple: Fitted, terms: Sequence[Term]
) -> tuple[Fitted, list[Needed]]:
    """Dwell or play, where the breakaways together show it although no trajectory needs a term."""
    by_slug = {term.slug: term for term in terms}
    for evidence in breakaway_evidence(evaluator, simple):
        if not evidence.convincing or evidence.slug not in by_slug:
            continue
        needed = with_breakaways(evaluator, simple, by_slug[evidence.slug], evidence)
        if needed.advantage.t >= LEAST_T[evidence.slug]:  # else something else moves the levels
            return needed.stage.accepted[0].fitted, [needed]
    return simple, []


def with_breakaways(
    evaluator: Evaluator, simple: Fitted, term: Term, evidence: BreakawayEvidence
) -> Needed:
    """``simple`` with a term of the size that the breakaways show."""
    neutral_fit = conclude(
        evaluator, neutral(evaluator, simple, simple.layout.hypothesis.plus(term))
    )
    fitted = refit_with_size(evaluator, neutral_fit, evidence)
    score = TermScore(term, fitted, gain(evaluator, simple, fitted))
    stage = SelectionStage(simple, (score,), (score,))
    return Needed(stage, simple, score.advantage, evidence)
