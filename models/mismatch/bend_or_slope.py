"""Whether a span error could be the bow of a linkage: over a part of the stroke the two are alike.

A bow that takes the place of the slope is fitted with everything else. Where it predicts unseen
blocks of time as well, both stay one class, and what would tell them apart is said: moves over so
much of the stroke that the bow leaves its straight line by what this record lets one see.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.mismatch import evaluator as base_coordinate
from stemwatch.models.mismatch.batched_search import conclude
from stemwatch.models.mismatch.crossfit import CAREFUL, Fitted, crossfit, gain
from stemwatch.models.mismatch.evaluator import Evaluator
from stemwatch.models.mismatch.term import Term
from stemwatch.models.mismatch.term_selection import AS_GOOD
from stemwatch.models.mismatch.terms.bowed_linkage import shape
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.parameters import Bounds

SPAN, BOW = "span_error", "bowed_linkage"
WIDER = 5.0  # percent of travel, step in which a wider movement is looked for at either end
# The rms of a bow about its straight line that shows, in scales of the loss: of 24 valves with a
# span error (seed 4060, development) the bow is told apart from 0.3 of it on.
SHOWS = 0.5


def bent_instead(evaluator: Evaluator, straight: Fitted, bow: Term) -> str | None:
    """A sentence on what would tell a bow from the span error of ``straight``; ``None`` where the
    record tells. The bow is fitted with the reading's gain held at 1.
    """
    bent = fitted_instead(evaluator, straight, base_coordinate.GAIN, bow)
    nearer = gain(evaluator, bent, straight)
    if nearer.t >= AS_GOOD:
        return None
    return _wider_movement(evaluator, abs(float(bent.values(BOW).mean())))


def fitted_instead(evaluator: Evaluator, fitted: Fitted, coordinate: int, term: Term) -> Fitted:
    """``fitted`` with a ``term`` in the place of one base coordinate, which is held at neutral."""
    layout = evaluator.layout(fitted.layout.hypothesis.plus(term))
    low, high = layout.bounds.low.copy(), layout.bounds.high.copy()
    low[coordinate] = high[coordinate] = 0.0
    layout = replace(layout, bounds=Bounds(low, high))
    middle, grid = fitted.candidates.mean(axis=0), term.starts(evaluator.summary)
    starts = np.zeros((grid.shape[0], layout.size))
    starts[:, : base_coordinate.N_BASE] = middle[: base_coordinate.N_BASE]
    for slug, coordinate_slice in fitted.layout.places.items():
        starts[:, layout.places[slug]] = middle[coordinate_slice]
    starts[:, layout.places[term.slug]] = grid
    return conclude(evaluator, crossfit(evaluator, layout, layout.bounds.clip(starts), CAREFUL))


def departure(low: float, high: float) -> float:
    """The rms of a bow of height 1 about its best straight line from ``low`` to ``high`` percent of
    travel."""
    places = np.linspace(low, high, 101)
    bow = shape(places)
    line: Floats = np.polynomial.Polynomial.fit(places, bow, 1)(places)
    return float(np.sqrt(np.mean((bow - line) ** 2)))


def _wider_movement(evaluator: Evaluator, height: float) -> str:
    """The sentence for a bow of ``height`` percent at its middle: the moves that would show it."""
    low, high = evaluator.summary.mv_low, evaluator.summary.mv_high
    alike = f"Over {low:.0f} to {high:.0f} % of travel a bow is nearly a straight line"
    while low > 0.0 or high < 100.0:
        low, high = max(low - WIDER, 0.0), min(high + WIDER, 100.0)
        if height * departure(low, high) >= SHOWS * evaluator.delta:
            return f"{alike}; moves from {low:.0f} to {high:.0f} % would tell the two apart."
    return f"{alike}; only a stroke check with the scale at the stem tells the two apart."
