"""How often the values of a signal change: at any sample, or at refreshes that are some apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats

LEAST_CHANGES = 30
ON_TIME = 0.98  # share of the changes that fall on the refresh
LONGEST = 120  # samples between refreshes


def refresh_period(values: Floats) -> tuple[int, int]:
    """Samples between refreshes of a signal (n,), and the first of them: (1, 0) where it may change
    at any sample.

    The longest period on which at least 98 % of its changes fall, from at least 30 changes.
    """
    changes = np.flatnonzero(np.abs(np.diff(values)) > 0.0) + 1
    if changes.size < LEAST_CHANGES or _at_any_sample(changes):
        return 1, 0
    for period in range(min(LONGEST, values.size // LEAST_CHANGES), 1, -1):
        phase_place, share = _favourite(changes, period)
        if share >= ON_TIME:
            return period, phase_place
    return 1, 0


def _at_any_sample(changes: NDArray[np.int64]) -> bool:
    """Whether too many changes follow one another at once for any period: of two neighbouring
    changes one is off the refresh, and a change that is off has two neighbours at most.
    """
    neighbours = np.count_nonzero(np.diff(changes) == 1)
    return bool(neighbours > 2.0 * (1.0 - ON_TIME) * changes.size + 1.0)


def _favourite(changes: NDArray[np.int64], period: int) -> tuple[int, float]:
    """The phase of a period at which most changes fall, and their share."""
    counts = np.bincount(changes % period, minlength=period)
    bin_place = int(counts.argmax())
    return bin_place, float(counts[bin_place] / changes.size)
