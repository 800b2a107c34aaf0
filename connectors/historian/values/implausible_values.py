"""Values that are no measurements although they are numbers: codes, states, silent dropouts.

Each finder returns a mask; it marks only where the column itself gives strong evidence, because
the same number may be a good value of another tag.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals import forensics
from stemwatch.models.signals.runs_of_samples import runs_of

# Below this a 32-bit float is denormal: an integer read as a float, not a measurement.
SMALLEST_REAL = 1e-37
# Archives mark "no value" by the largest float they have; no plant measures this much.
LARGEST_REAL = 1e30
# PI system states that leak through as numbers (PI Server documentation, digital state set SYSTEM).
PI_STATES = np.array(
    [210, 211, 212, 213, 214, 215, 216, 217, 233, 237, 238, 239, 240, 241, 242, 243, 244, 245,
     246, 248, 249, 255, 307, 313], dtype=np.float64,
)  # fmt: skip
_FEWEST = 20  # values a column must have before it can exclude any
_LONGEST_DROPOUT = 8
_LONGEST_SCAN = 600  # ticks
_BESIDE = 10  # neighbours looked at on each side of a dropout


def denormal_values(values: Floats) -> Bools:
    """(n,) True for non-zero magnitudes below ``SMALLEST_REAL``."""
    return np.asarray((values != 0.0) & (np.abs(values) < SMALLEST_REAL))


def out_of_float_range(values: Floats) -> Bools:
    """(n,) True for magnitudes that no signal can have."""
    return np.asarray(np.abs(values) >= LARGEST_REAL)


def pi_states(values: Floats) -> Bools:
    """(n,) True for integers of PI's system states in a column whose own range excludes them.

    Excluded means above the largest other value by more than the whole range of the others (and
    by more than its tenth): 246 among 40-60 %, but not among 180-240.
    """
    none = np.zeros(values.size, dtype=bool)
    if not (values >= PI_STATES[0]).any():
        return none  # true of most columns; comparing each value with each state takes longer
    suspects = np.isin(values, PI_STATES)
    others = values[np.isfinite(values) & ~suspects]
    if not suspects.any() or others.size < _FEWEST:
        return none
    low, high = float(others.min()), float(others.max())
    limit = high + max(high - low, 0.1 * abs(high), 1.0)
    return np.asarray(suspects & (values > limit))


def zero_dropouts(values: Floats) -> Bools:
    """(n,) True for short runs of exactly 0 between values that are far from it.

    A run counts when it has at most 8 samples, its 10 neighbours on either side lie more than 20
    of their own standard deviations (and noise, and quantum) from 0, and zeros make up less than
    1 % of a column with many levels. A level that the signal also reaches by itself is never one.
    """
    is_dropout = np.zeros(values.size, dtype=bool)
    zero = values == 0.0
    finite = np.isfinite(values)
    n_zero = int(zero.sum())
    if not 0 < n_zero <= max(1, int(0.01 * finite.sum())):
        return is_dropout
    if np.unique(values[finite & ~zero]).size < 8:
        return is_dropout
    without_zeros = np.where(zero, np.nan, values)
    floor = max(forensics.noise_sigma(without_zeros), forensics.quantum(without_zeros))
    for start, stop in runs_of(zero).tolist():
        if stop - start <= _LONGEST_DROPOUT and _far_from_zero(without_zeros, start, stop, floor):
            is_dropout[start:stop] = True
    return is_dropout


def _far_from_zero(without_zeros: Floats, start: int, stop: int, floor: float) -> bool:
    before, after = (
        without_zeros[max(0, start - _BESIDE) : start],
        without_zeros[stop : stop + _BESIDE],
    )
    before, after = before[np.isfinite(before)], after[np.isfinite(after)]
    if before.size < 3 or after.size < 3:
        return False
    neighbours = np.concatenate((before, after))
    spread = max(float(np.std(neighbours)), floor)
    same_sign = bool((neighbours > 0).all() or (neighbours < 0).all())
    return same_sign and float(np.abs(neighbours).min()) > 20.0 * spread


def own_interval(ticks: NDArray[np.int64], values: Floats, *, command: bool) -> float | None:
    """Ticks between the column's own samples where they are slower than the clock, else ``None``.

    ``ticks`` (n,) are the samples' times in whole intervals. A scan shows as changes on a lattice:
    nearly all of them a multiple of one period apart. For a measurement, changes at nearly regular
    distances (median absolute deviation at most a third of the median) show the rate at which the
    archive stored values; a ``command`` may rest as long as it likes.
    """
    filled = np.isfinite(values)
    if not filled.all():
        ticks, values = ticks[filled], values[filled]
    changes = ticks[1:][values[1:] != values[:-1]]
    if changes.size < 8:
        return None
    distance = np.diff(changes)
    if 2 * np.count_nonzero(distance <= 1) > distance.size:
        return None  # the median is 1, which most measurements have; looking for it takes longer
    median_distance = float(np.median(distance))
    if median_distance < 1.5:
        return None
    for period in range(int(min(median_distance * 1.5, _LONGEST_SCAN)), 1, -1):
        phases = np.bincount(changes % period, minlength=period)
        if phases.max() >= 0.9 * changes.size:
            return float(period)
    spread = float(np.median(np.abs(distance - median_distance)))
    return median_distance if spread <= median_distance / 3.0 and not command else None
