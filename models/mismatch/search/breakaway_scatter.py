"""How far breakaways scatter, and what their scatter and the readings' noise stand for.

Where breakaways reach far beyond the noise, their scatter hides effects from trajectories. A point
of the likelihood that needs more scatter than stems have, or readings further from the stem than
their noise, leaves something else unexplained: a search that has ended too soon, or physics that is
in no hypothesis.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from stemwatch.models.mismatch.fit.base_coordinate import RATIO, S_PERCENT, S_and_J
from stemwatch.models.mismatch.fit.crossfit import Fitted
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.likelihood.likelihood_evidence import evidence_of
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    FEW_COURSES,
    MORE_ROUNDS,
    OF_STEMS,
    RELEASED,
    SCATTERS,
    Likeliest,
    RecordLikelihood,
)

LEAST_LEVEL, LEAST_LEVEL_IN_NOISE = 0.25, 2.0  # percent; standard deviations of the noise
# Share of the limit of the scatter that is at the limit, and least t there. Of valves with physics
# outside the catalogue four were named at the limit, with t up to 3.9; of those with an effect that
# trajectories miss four, with 5.6 and more (seeds 4063 and 2108).
WIDEST, ALL_OVER = 0.95, 5.0
# Where a smaller scatter is looked for: shares of the breakaway level, and J/S.
LEVELS_OF_LESS_SCATTER, RATIOS_OF_LESS_SCATTER = (0.85, 1.0, 1.15, 1.3, 1.5), (0.05, 0.2, 0.4, 0.7)
LOOKS_OF_LESS_SCATTER, CLIMBED_OF_LESS_SCATTER = 6, 2
MORE_THAN_NOISE = 1.5
# Share of the level by which breakaways may scatter where friction is not one number: five times
# what simulated stems do at most, four times the limit of the searches.
OF_NO_STEM = 0.6


def scatter_matters(evaluator: Evaluator, fitted: Fitted) -> bool:
    """Whether breakaways reach so far beyond the noise that their scatter hides anything; of a stem
    that hardly sticks trajectories show all there is.
    """
    S, ratio = fitted.candidates.mean(axis=0)[[S_PERCENT, RATIO]]
    level = 0.5 * float(S * (1.0 + ratio))
    return level >= max(LEAST_LEVEL, LEAST_LEVEL_IN_NOISE * evaluator.problem.sigma)


def leaves_something(at: Likeliest, evaluator: Evaluator, widest: float = SCATTERS[1]) -> bool:
    """Whether the breakaways scatter more than those of real stems, or the readings more than their
    noise. Something else is hidden then, for which a term may stand, and samples are not
    independent: it must be more likely all over the record.
    """
    return scatters_most(at, widest) or too_noisy(evaluator, at)


def scatters_most(at: Likeliest, widest: float = SCATTERS[1]) -> bool:
    """Whether the scatter is at its limit, which is ``widest``."""
    return at.scatter > WIDEST * widest


def too_noisy(evaluator: Evaluator, at: Likeliest) -> bool:
    """Whether the readings lie about the stem by more than their noise."""
    return at.noise > MORE_THAN_NOISE * evaluator.problem.sigma


def scatters_as_no_stem(likelihood: RecordLikelihood, at: Likeliest) -> bool:
    """Whether a scatter beyond that of any stem makes the record more likely than ``at`` by as much
    as a term that is named does. Friction that comes and goes, or a force from outside, is left
    then, whatever else is there; a smaller scatter elsewhere must not do as well.
    """
    if at.scatter <= WIDEST * OF_STEMS:
        return False
    wide = replace(likelihood, widest=OF_NO_STEM).again(at)
    return wide.scatter > at.scatter and evidence_of(wide, at).strength >= 1.0


def less_scattered(likelihood: RecordLikelihood, at: Likeliest) -> Likeliest:
    """A point that leaves something in scatter or noise, or a better one that is found from small
    scatters, other levels and other J: these also stand for what S and J are wrong by.
    """
    if not leaves_something(at, likelihood.evaluator):
        return at
    layout, quick = at.layout, replace(likelihood, courses=FEW_COURSES)
    S, J = S_and_J(at.candidate)
    points = []
    for level, ratio in product(LEVELS_OF_LESS_SCATTER, RATIOS_OF_LESS_SCATTER):
        row = at.candidate.copy()
        row[S_PERCENT], row[RATIO] = level * (S + J) / (1.0 + ratio), ratio
        points.append(np.concatenate((row, at.of_record[:1], likelihood.first_of_record[1:])))
    begun = quick.ranked(layout, points)[:LOOKS_OF_LESS_SCATTER]
    begun = sorted((quick.climbed(one, MORE_ROUNDS) for one in begun), key=lambda one: -one.total)
    points = [one.point for one in begun[:CLIMBED_OF_LESS_SCATTER]]
    return max(at, likelihood.maximised(layout, points), key=lambda at: at.total)


def released(
    likelihood: RecordLikelihood, simple: Likeliest, rich: Likeliest
) -> tuple[Likeliest, Likeliest]:
    """Two points searched again at a wider limit of the scatter."""
    wide = replace(likelihood, widest=RELEASED)
    return wide.again(simple), wide.again(rich)
