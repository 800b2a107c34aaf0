"""Other S and J by which the stem comes to rest in the same places.

Where the stem rests tells S - J to a fraction of the noise. S and J apart show in when it lets go,
and that shows little where its slips hardly reach beyond the noise: the likelihood then has a ridge
along which S and J grow together, with many tops, and a climb ends on the nearest.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from stemwatch.models.mismatch.fit.base_coordinate import RATIO, S_PERCENT, S_and_J
from stemwatch.models.mismatch.likelihood.maximum_likelihood import Likeliest, RecordLikelihood
from stemwatch.models.recording import Floats

JUMPS = 24  # J that are looked at, in equal steps
TIMES_J, OF_S = 2.5, 0.6  # the largest of them: times J, and of S, whichever is more
SCATTERED = (0.03, 0.07, 0.15)  # of the level: with the right J breakaways may scatter less
LEAST_S = 0.2  # percent


def along_the_ridge(likelihood: RecordLikelihood, at: Likeliest) -> Likeliest:
    """The point ``at``, or a more likely one by which the stem comes to rest where it did."""
    found = likelihood.maximised(at.layout, [at.point, *_with_other_jumps(at)])
    return max(at, found, key=lambda one: one.total)


def with_breakaway(row: Floats, level: float) -> Floats:
    """A row (size,) with another breakaway level ``(S + J)/2``, percent, and its sliding level
    ``(S - J)/2``, at which the stem comes to rest."""
    sliding, other = sliding_level(row), row.copy()
    other[S_PERCENT] = level + sliding
    other[RATIO] = (level - sliding) / (level + sliding)
    return other


def sliding_level(row: Floats) -> float:
    """``(S - J)/2`` of a row (size,), percent."""
    S, J = S_and_J(row)
    return 0.5 * (S - J)


def _with_other_jumps(at: Likeliest) -> Iterator[Floats]:
    """Points (size + 2,) with other J, from none on, at the sliding level of ``at``."""
    (S, J), sliding = S_and_J(at.candidate), sliding_level(at.candidate)
    for jump in np.linspace(0.0, max(TIMES_J * J, OF_S * S), JUMPS):
        row = with_breakaway(at.candidate, max(sliding + jump, LEAST_S - sliding))
        for scatter in SCATTERED:
            yield np.concatenate((row, at.of_record[:1], [np.log(scatter)]))
