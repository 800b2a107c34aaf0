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


def _with_other_jumps(at: Likeliest) -> Iterator[Floats]:
    """Points (size + 2,) with the same S - J."""
    S, J = S_and_J(at.candidate)
    for jump in np.linspace(0.0, max(TIMES_J * J, OF_S * S), JUMPS):
        for scatter in SCATTERED:
            point = at.point.copy()
            point[S_PERCENT] = max(S - J + jump, LEAST_S)
            point[RATIO], point[-1] = jump / point[S_PERCENT], np.log(scatter)
            yield point
