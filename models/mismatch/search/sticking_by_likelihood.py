"""A stem that sticks again, shown by the likelihood of the whole record where no trajectory does.

After its short slips such a stem is soon a slip ahead of any simulated run or behind it, and what a
run gains in one rest it loses in the next. The likelihood follows every moment at which the stem
may have let go or stuck, and compares a stem that sticks again with one that slides on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.mismatch.fit.base_coordinate import RATIO, RESTICK, S_PERCENT
from stemwatch.models.mismatch.fit.base_fit import RESTICK_REACH, sticking_again
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout
from stemwatch.models.mismatch.likelihood.likelihood_evidence import LikelihoodEvidence, evidence_of
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    FEW_COURSES,
    RELEASED,
    Likeliest,
    RecordLikelihood,
    points_at,
)
from stemwatch.models.mismatch.search.breakaway_scatter import (
    leaves_something,
    less_scattered,
    released,
    scatter_matters,
    scatters_most,
)
from stemwatch.models.mismatch.search.compared_by_likelihood import WORTH
from stemwatch.models.mismatch.search.named_at_likeliest import held, scored_at
from stemwatch.models.mismatch.search.named_terms import Named, shown_by_likelihood
from stemwatch.models.mismatch.search.reading_errors import (
    COORDINATES,
    LEAST_RESTICK,
    pinned,
    values_of,
)
from stemwatch.models.mismatch.search.reading_errors import RESTICK as SLUG
from stemwatch.models.mismatch.terms.low_speed_restick import TERM
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.parameters import Bounds

# Least strength. Of 141 valves of development without such a stem (`draw_hidden`, seed 4090,
# `draw_nulls`, 4064, `draw_unknown`, 4063) it comes to 0.3 at most where nothing is left over; but
# for a spring with hysteresis, at a speed that is too small to be named. Of such stems (4090) one
# that is quantised comes to 0.4, and seven to 0.9 and more.
HARDER = 0.8
SPEEDS = (0.25, 1.0, 4.0)  # %/s
LOOKS, ROUNDS = 8, 3  # starts that are climbed from at the first look, and how far
CLIMBED = 2  # of these, from which the search goes on
SLIDES = 0.05  # %/s, at which a stem that slides on is begun
# The speed is held where the likelihood falls by no more than this, its interval of 95 %; asked at
# as many speeds as this, in equal ratios. The likelihood is not smooth in the speed, so its slopes
# say little: within twice the standard errors from them, trajectories took 2.0 and 0.8 %/s to 0.12
# and 0.18 (`draw_hidden`, seed 4090, 103 and 189), which is no effect any more.
LESS_LIKELY, SPEEDS_ASKED = 2.0, 40


def sticking_by_likelihood(named: Named) -> Named:
    """``named`` with a stem that sticks again, if the likelihood shows it; else as it was."""
    if named.sticks_again is not None or not scatter_matters(named.evaluator, named.fitted):
        return named
    likelihood = RecordLikelihood(named.evaluator)
    found = _found(likelihood, named)
    if found is None:
        return named
    sticking, evidence = found
    speed = values_of(SLUG, sticking.candidate)
    if evidence.strength < HARDER or not TERM.material(speed, named.evaluator.summary):
        return named
    if leaves_something(sticking, named.evaluator, RELEASED):
        return named  # rough forces, and what shakes a stem, stop it again and again as well
    layout = held(likelihood, sticking, (S_PERCENT, RATIO, *_shown_sizes(named)))
    layout = _held_speed(likelihood, sticking, layout)
    fitted = scored_at(named.evaluator, layout, sticking.candidate)
    return replace(named, fitted=fitted, sticks_again=evidence)


def _found(
    likelihood: RecordLikelihood, named: Named
) -> tuple[Likeliest, LikelihoodEvidence] | None:
    """The most likely stem that sticks again, and how much more likely the record is by it;
    ``None`` where a first look shows that it is not worth a search.
    """
    layout, quick = _free(named), replace(likelihood, courses=FEW_COURSES)
    slides = pinned(layout, RESTICK, COORDINATES[SLUG][1])
    first = likelihood.first_of_record
    begun = quick.climbed(quick.ranked(slides, points_at(named.fitted, first))[0])
    begun = less_scattered(quick, begun)
    middle = begun.candidate[None]
    starts = np.vstack((*sticking_again(layout, middle), *_at_speeds(middle)))
    points = [np.append(row, begun.of_record) for row in starts]
    looks = sorted(
        (quick.climbed(one, ROUNDS) for one in quick.ranked(layout, points)[:LOOKS]),
        key=lambda one: -one.total,
    )
    if looks[0].total - begun.total < WORTH:
        return None
    sliding = likelihood.maximised(slides, [begun.point])
    ahead = [one.point for one in looks[:CLIMBED]]
    sticking = less_scattered(likelihood, likelihood.maximised(layout, ahead))
    # Each is searched on, and from where the other has ended; the simpler one last.
    sliding = less_scattered(likelihood, _searched_on(likelihood, sliding, sticking, SLIDES))
    sticking = _searched_on(likelihood, sticking, sliding, float(sticking.candidate[RESTICK]))
    sliding = _searched_on(likelihood, sliding, sticking, SLIDES)
    if scatters_most(sticking):
        sliding, sticking = released(likelihood, sliding, sticking)
    return sticking, evidence_of(sticking, sliding)


def _free(named: Named) -> CoordinateLayout:
    """The layout of what is named, without the limits near to what the likelihood has shown: beside
    a stem that sticks again its S, J and sizes are others.
    """
    if not shown_by_likelihood(named):
        return named.fitted.layout
    return named.evaluator.layout(named.fitted.layout.hypothesis)


def _shown_sizes(named: Named) -> list[int]:
    """The coordinates of the terms that the likelihood has shown."""
    places = named.fitted.layout.places
    return [
        place
        for needed in named.needed
        if needed.likelihood is not None
        for place in range(places[needed.term.slug].start, places[needed.term.slug].stop)
    ]


def _searched_on(
    likelihood: RecordLikelihood, at: Likeliest, rival: Likeliest, speed: float
) -> Likeliest:
    """A point searched on, or searched from that of its ``rival`` at a ``speed`` of its own."""
    from_rival = rival.point.copy()
    from_rival[RESTICK] = speed
    again = likelihood.maximised(at.layout, [at.point, from_rival])
    return max(at, again, key=lambda one: one.total)


def _held_speed(
    likelihood: RecordLikelihood, at: Likeliest, layout: CoordinateLayout
) -> CoordinateLayout:
    """``layout`` with the speed of a stem that sticks again held where the record is about as
    likely as ``at`` the most likely one, all else as it is there.
    """
    speed = at.candidate[RESTICK]
    low, high = layout.bounds.low.copy(), layout.bounds.high.copy()
    grid = np.geomspace(LEAST_RESTICK, RESTICK_REACH, SPEEDS_ASKED)
    points = np.tile(at.point, (grid.size, 1))
    points[:, RESTICK] = grid
    totals = likelihood.of_blocks_each(at.layout, points).sum(axis=1)
    worse = grid[totals < at.total - LESS_LIKELY]
    low[RESTICK] = max(worse[worse < speed], default=LEAST_RESTICK)
    high[RESTICK] = min(worse[worse > speed], default=RESTICK_REACH)
    return replace(layout, bounds=Bounds(low, high))


def _at_speeds(candidates: Floats) -> list[Floats]:
    """Variants of candidates (m, size) that stick again at a speed, all else as it is."""
    variants = []
    for speed in SPEEDS:
        variant = candidates.copy()
        variant[:, RESTICK] = speed
        variants.append(variant)
    return variants
