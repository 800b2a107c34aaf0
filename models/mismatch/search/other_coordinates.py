"""A fitted hypothesis in the coordinates of another one, which has more terms or fewer, and two
hypotheses put together as a start for both their terms.

Searched one on top of the other, two terms end where the first one was, which has taken the part
of the second as well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import Search
from stemwatch.models.mismatch.fit.crossfit import BestOfFolds, Fitted, best_of_folds
from stemwatch.models.mismatch.fit.evaluator import DEAD_TIME, CoordinateLayout, Evaluator
from stemwatch.models.mismatch.search.breakaway_levels import PLAY
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.parameters import Bounds

# Shares of their fitted sizes at which two hypotheses are put together.
SHARES = ((1.0, 1.0), (1.0, 0.5), (0.5, 1.0), (0.5, 0.5))


def carried_over(fitted: Fitted, layout: CoordinateLayout) -> Floats:
    """(2, size) the candidates of ``fitted`` in the coordinates of a ``layout`` with more terms,
    which are neutral, or with fewer.

    A dead time takes the place of the base's delay, and the other way round.
    """
    candidates = np.zeros((2, layout.size))
    candidates[:, : base_coordinate.N_BASE] = fitted.candidates[:, : base_coordinate.N_BASE]
    shared = layout.places.keys() & fitted.layout.places.keys()
    for slug in shared:
        candidates[:, layout.places[slug]] = fitted.values(slug)
    if DEAD_TIME in layout.places.keys() - shared:
        candidates[:, layout.places[DEAD_TIME]] = fitted.candidates[:, [base_coordinate.DELAY]]
    elif DEAD_TIME in fitted.layout.places.keys() - shared:
        candidates[:, [base_coordinate.DELAY]] = fitted.values(DEAD_TIME)
    return layout.bounds.clip(candidates)


def in_bounds_of(layout: CoordinateLayout, other: CoordinateLayout) -> CoordinateLayout:
    """``layout`` with the bounds of another one on all that they share."""
    low, high = layout.bounds.low.copy(), layout.bounds.high.copy()
    base = slice(0, base_coordinate.N_BASE)
    shared = layout.places.keys() & other.places.keys()
    places = [(layout.places[slug], other.places[slug]) for slug in shared]
    for own, there in ((base, base), *places):
        low[own], high[own] = other.bounds.low[there], other.bounds.high[there]
    return replace(layout, bounds=Bounds(low, high))


def without(fitted: Fitted, layout: CoordinateLayout) -> list[Floats]:
    """Candidates (2, size) of ``fitted`` in a ``layout`` with fewer terms, from which to search: as
    they are, and where play is left out also with the play as a dead band of friction, by which S
    grows while J stays. S alone may have another optimum at either.
    """
    plain = carried_over(fitted, layout)
    if PLAY not in fitted.layout.places.keys() - layout.places.keys():
        return [plain]
    with_play = plain.copy()
    S = plain[:, base_coordinate.S_PERCENT]
    with_play[:, base_coordinate.S_PERCENT] = S + fitted.values(PLAY)[:, 0]
    with_play[:, base_coordinate.RATIO] *= S / np.maximum(
        with_play[:, base_coordinate.S_PERCENT], 1e-9
    )
    return [plain, layout.bounds.clip(with_play)]


def best_together(
    evaluator: Evaluator, layout: CoordinateLayout, parts: tuple[Fitted, Fitted], keep: int
) -> Search[BestOfFolds]:
    """The ``keep`` best starts of a ``layout`` that holds the terms of two hypotheses."""
    starts = put_together(layout, *parts)
    best = yield from best_of_folds(evaluator, layout, starts, keep)
    return best


def put_together(layout: CoordinateLayout, first: Fitted, second: Fitted) -> Floats:
    """(2, m, size) starts on either fold of a ``layout`` with the terms of two hypotheses.

    S, J and the reading are those of the one or of the other, which each had to make up for what
    it lacked; the terms are as large as they were fitted or half as large, because each has taken
    the part of the other as well.
    """
    starts = []
    for base in (first, second):
        start = carried_over(base, layout)
        for share_of_first, share_of_second in SHARES:
            part = start.copy()
            for fitted, share in ((first, share_of_first), (second, share_of_second)):
                for slug in fitted.slugs:
                    part[:, layout.places[slug]] = share * fitted.values(slug)
            starts.append(layout.bounds.clip(part))
    return np.stack(starts, axis=1)
