"""A stem that sticks again, shown by the likelihood of the whole record where no trajectory does.

After its short slips such a stem is soon a slip ahead of any simulated run or behind it, and what a
run gains in one rest it loses in the next. The likelihood follows every moment at which the stem
may have let go or stuck, and compares a stem that sticks again with one that slides on.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.mismatch.fit.base_coordinate import RATIO, RESTICK, S_PERCENT
from stemwatch.models.mismatch.fit.base_fit import sticking_again
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    RELEASED,
    Likeliest,
    LikelihoodEvidence,
    RecordLikelihood,
)
from stemwatch.models.mismatch.search.named_by_likelihood import (
    FEW_COURSES,
    WORTH,
    evidence_of,
    held,
    leaves_something,
    less_scattered,
    points_at,
    released,
    scatter_matters,
    scatters_most,
    scored_at,
)
from stemwatch.models.mismatch.search.reading_errors import COORDINATES, LEAST_RESTICK, pinned
from stemwatch.models.mismatch.search.reading_errors import RESTICK as SLUG
from stemwatch.models.mismatch.search.term_selection import Named
from stemwatch.models.recording import Floats

# Least strength: below it valves whose clocks jitter, or whose stem stands at a stop, show it too.
HARDER = 1.3
SPEEDS = (0.25, 1.0, 4.0)  # %/s
LOOKS, ROUNDS = 2, 2  # starts that are climbed from at the first look, and how far
SLIDES = 0.05  # %/s, at which a stem that slides on is begun


def sticking_by_likelihood(named: Named) -> Named:
    """``named`` with a stem that sticks again, if the likelihood shows it; else as it was."""
    if named.sticks_again is not None or not scatter_matters(named.evaluator, named.fitted):
        return named
    likelihood = RecordLikelihood(named.evaluator)
    found = _found(likelihood, named)
    if found is None:
        return named
    sticking, evidence = found
    if evidence.strength < HARDER or sticking.candidate[RESTICK] < LEAST_RESTICK:
        return named
    if leaves_something(sticking, named.evaluator, RELEASED):
        return named  # rough forces, and what shakes a stem, stop it again and again as well
    layout = held(likelihood, sticking, (S_PERCENT, RATIO, RESTICK))
    fitted = scored_at(named.evaluator, layout, sticking.candidate)
    return replace(named, fitted=fitted, sticks_again=evidence)


def _found(
    likelihood: RecordLikelihood, named: Named
) -> tuple[Likeliest, LikelihoodEvidence] | None:
    """The most likely stem that sticks again, and how much more likely the record is by it;
    ``None`` where a first look shows that it is not worth a search.
    """
    layout, quick = named.fitted.layout, replace(likelihood, courses=FEW_COURSES)
    slides = pinned(layout, RESTICK, COORDINATES[SLUG][1])
    first = likelihood.first_of_record
    begun = quick.climbed(quick.ranked(slides, points_at(named.fitted, first))[0])
    begun = less_scattered(quick, begun)
    middle = begun.candidate[None]
    starts = np.vstack((*sticking_again(layout, middle), *_at_speeds(middle)))
    points = [np.append(row, begun.of_record) for row in starts]
    look = max(
        (quick.climbed(one, ROUNDS) for one in quick.ranked(layout, points)[:LOOKS]),
        key=lambda one: one.total,
    )
    if look.total - begun.total < WORTH:
        return None
    sliding = likelihood.maximised(slides, [begun.point])
    sticking = less_scattered(likelihood, likelihood.maximised(layout, [look.point]))
    less = sticking.candidate.copy()
    less[RESTICK] = SLIDES
    again = likelihood.maximised(slides, [np.append(less, sticking.of_record)])
    sliding = less_scattered(likelihood, max(sliding, again, key=lambda one: one.total))
    if scatters_most(sticking):
        sliding, sticking = released(likelihood, sliding, sticking)
    return sticking, evidence_of(sticking, sliding)


def _at_speeds(candidates: Floats) -> list[Floats]:
    """Variants of candidates (m, size) that stick again at a speed, all else as it is."""
    variants = []
    for speed in SPEEDS:
        variant = candidates.copy()
        variant[:, RESTICK] = speed
        variants.append(variant)
    return variants
