"""Dwell beside what trajectories have named.

Of two effects the one that moves the stem is found, and the dwell that raises its breakaways is
lost: no trajectory shows it, and the few breakaways of an hour show it by two or three standard
errors, as chance does among many valves. The likelihood of the whole record asks another question
of the same record: whether it is more likely with a rise of that size. Where both say so, it is
named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from stemwatch.models.mismatch.likelihood.likelihood_evidence import LEAST_T
from stemwatch.models.mismatch.search.breakaway_levels import (
    DWELL,
    LEAST_SIZE,
    MOST_SIZE,
    BreakawayEvidence,
    breakaway_evidence,
)
from stemwatch.models.mismatch.search.breakaway_scatter import leaves_something
from stemwatch.models.mismatch.search.compared_by_likelihood import likelihood_with
from stemwatch.models.mismatch.search.named_by_breakaways import with_breakaways
from stemwatch.models.mismatch.search.named_terms import Named, Needed
from stemwatch.models.mismatch.search.term_selection import MOST_TERMS
from stemwatch.models.mismatch.term import Term

LEAST_Z_BESIDE = 3.0


def with_dwell(named: Named, terms: Sequence[Term]) -> Named:
    """``named`` with dwell beside it, if breakaways and likelihood both show it; else as it was."""
    term = next((term for term in terms if term.slug == DWELL), None)
    if term is None or DWELL in named.fitted.slugs or len(named.needed) >= MOST_TERMS:
        return named
    seen = _seen(named)
    if seen is None:
        return named
    needed = with_breakaways(named.evaluator, named.fitted, term, seen)
    if not _is_likely(named, needed):
        return named
    fitted = needed.stage.accepted[0].fitted
    return replace(named, fitted=fitted, needed=(*named.needed, needed))


def _seen(named: Named) -> BreakawayEvidence | None:
    """What the breakaways tell of dwell beside what is named, if that is worth another question."""
    for seen in breakaway_evidence(named.evaluator, named.fitted):
        if seen.slug == DWELL and seen.z >= LEAST_Z_BESIDE:
            return seen if LEAST_SIZE[DWELL] <= seen.size <= MOST_SIZE[DWELL] else None
    return None


def _is_likely(named: Named, needed: Needed) -> bool:
    """Whether the record as a whole is more likely with dwell, and nothing else seems hidden
    then."""
    compared = likelihood_with(named, needed.stage.accepted[0])
    if compared is None or leaves_something(compared.rich, named.evaluator):
        return False
    return compared.evidence.t >= LEAST_T
