"""Where a position reading was frozen: exact repeats that neither noise nor friction can make."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.forensics import turns_like_noise
from stemwatch.models.recording import Bools, Floats

FROZEN_S, FROZEN_SAMPLES = 30.0, 20
LEAST_TURNS = 60  # samples by which the noise is judged
LONGER = 5.0  # times the usual long repeat of the reading that a frozen one lasts
LASTING = (10.0, 90.0)  # percentiles of OP within a run
BAND_MARGIN, BAND_EXTRA = 1.5, 1.0  # times the stem's band, plus percent, that OP must move


def frozen_samples(op: Floats, mv: Floats, interval_s: float, *, compressed: bool) -> Bools:
    """(n,) True where the reading was frozen; the first sample of a run is its last true one.

    A run of exact repeats of at least 30 s is frozen where the reading shows noise everywhere else
    and never repeats itself for a fifth as long, or where OP moves within it by more than one and a
    half times the band in which friction could hold the stem, plus 1 %. Where the archive drew or
    held values (``compressed``), only the second counts.
    """
    frozen = np.zeros(mv.size, dtype=bool)
    runs = _repeats(mv)
    length = runs[:, 1] - runs[:, 0]
    long = length >= max(FROZEN_SAMPLES, round(FROZEN_S / interval_s))
    if not long.any():
        return frozen
    outside = np.isfinite(mv) & np.isfinite(op)
    for first, last in runs[long]:
        outside[first + 1 : last] = False
    noisy = not compressed and turns_like_noise(mv, runs[long], LEAST_TURNS)
    usual = float(np.percentile(length[~long], 99.0)) if (~long).any() else 1.0
    band = _band(op, mv, outside)
    for first, last in runs[long]:
        by_noise = noisy and last - first >= LONGER * usual
        moved = op[first:last][np.isfinite(op[first:last])]
        # A kick of a second or two is over before the stem can answer.
        far = float(np.ptp(np.percentile(moved, LASTING))) if moved.size else 0.0
        if by_noise or far > BAND_MARGIN * band + BAND_EXTRA:
            frozen[first + 1 : last] = True
    return frozen


def _repeats(mv: Floats) -> NDArray[np.int64]:
    """(m, 2) first and last + 1 of each run of equal values, the value's first sample included."""
    same = np.concatenate(([0], (np.diff(mv) == 0.0).astype(np.int8), [0]))
    edges = np.flatnonzero(np.diff(same)).reshape(-1, 2)
    return np.column_stack((edges[:, 0], edges[:, 1] + 1)).astype(np.int64)


def _band(op: Floats, mv: Floats, outside: Bools) -> float:
    """Range of OP over which the stem was seen not to follow, percent: of ``op - mv`` elsewhere."""
    if np.count_nonzero(outside) < LEAST_TURNS:
        return float("inf")
    low, high = np.percentile((op - mv)[outside], (2.0, 98.0))
    return float(high - low)
