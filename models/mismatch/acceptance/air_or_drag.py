"""A stem that is slow: thick grease, or air that takes longer once the stem moves?

While a stem is stuck, the chamber of its actuator is smaller than while it moves and the volume
grows, so that the same air line fills it 2 to 2.7 times as fast at rest. Such a stem starts nearly
on time and slides slowly, as one with viscous drag does. Where drag is named, the same slowness is
therefore fitted once more as air: a lag at rest of ``AT_REST`` of it, all of it in motion. Where
that is as good on unseen blocks, the recording cannot tell air from grease, and both are named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import POLISH, Fitted, gain, refit, scored
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.search.explaining_terms import AS_GOOD
from stemwatch.models.mismatch.search.named_terms import Named, Needed, TermScore
from stemwatch.models.mismatch.search.term_scores import neutral
from stemwatch.models.mismatch.term import Term
from stemwatch.models.stickslip.parameters import Bounds

DRAG, AIR = "viscous_drag", "actuator_lag"
AT_REST = 0.42  # of the lag in motion; the chamber is 2 to 2.7 times as quick


def or_air(named: Named, terms: Sequence[Term]) -> Named:
    """``named``, its drag together with the air where the recording cannot tell them apart.

    ``terms`` are those that the recording could have shown.
    """
    air = next((term for term in terms if term.slug == AIR), None)
    if air is None or DRAG not in named.fitted.slugs or AIR in named.fitted.slugs:
        return named
    if any(AIR in item.members for item in named.needed if item.term.slug == DRAG):
        return named
    slower = as_air(named.evaluator, named.fitted, air)
    if gain(named.evaluator, slower, named.fitted).t >= AS_GOOD:
        return named
    needed = tuple(
        _beside(item, TermScore(air, slower, gain(named.evaluator, item.without, slower)))
        if item.term.slug == DRAG
        else item
        for item in named.needed
    )
    return replace(named, needed=needed)


def as_air(evaluator: Evaluator, fitted: Fitted, air: Term) -> Fitted:
    """``fitted`` with a part of its drag as a lag of the command, held at that part, refitted."""
    hypothesis = fitted.layout.hypothesis.plus(air)
    begun = conclude(evaluator, neutral(evaluator, fitted, hypothesis))
    layout, candidates = begun.layout, begun.candidates.copy()
    drag, lag = layout.places[DRAG], layout.places[AIR]
    low, high = layout.bounds.low.copy(), layout.bounds.high.copy()
    at_rest = AT_REST * float(candidates[:, drag].mean())
    low[lag] = high[lag] = at_rest
    candidates[:, drag] = np.maximum(candidates[:, drag] - at_rest, 0.0)
    candidates[:, lag] = at_rest
    layout = replace(layout, bounds=Bounds(low, high))
    start = conclude(evaluator, scored(layout, layout.bounds.clip(candidates)))
    return conclude(evaluator, refit(evaluator, start, POLISH))


def _beside(item: Needed, score: TermScore) -> Needed:
    """``item`` with one more term that explains the recording as well."""
    stage = replace(item.stage, accepted=(*item.stage.accepted, score))
    return replace(item, stage=stage)
