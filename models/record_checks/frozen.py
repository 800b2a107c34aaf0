"""Where the position reading was frozen: exact repeats that neither noise nor friction explains.

There are three tests, at different times.

``mostly_one_value`` looks at any single tag, during an inspection, before it is known which tag is
the position.

``frozen_runs`` comes before any fit: can this recording be judged, and which samples must be
masked? How far friction can hold the stem is not known yet, so a run of a coarse reading is
compared with the valve's other rests, and only a clear case is masked.

``frozen_samples`` comes when the mismatch is explained: is a freezing transmitter one of the
record's effects? By then it is known whether the archive interpolated or held values, and how far
OP moves without the stem elsewhere in the record, so that a shorter freeze can be separated from a
rest.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats, Quality, Recording, Role
from stemwatch.models.signals.excitation import ranges
from stemwatch.models.signals.forensics import repeat_share, turns_like_noise
from stemwatch.models.signals.runs_of_samples import Runs, equal_runs

# A tag is frozen when one value lasts for this share of its samples, and at least so many, after it
# has moved.
SHARE_OF_A_TAG, SAMPLES_OF_A_TAG = 0.25, 60
# A noisy transmitter does not repeat itself to the last bit for this long.
FROZEN_S, FROZEN_SAMPLES = 30.0, 20
# Before a fit.
MOST_REPEATS = 0.3  # a reading that repeats itself less often than this has noise
LEAST_REPEATS = 4  # samples of a run that counts as one of the valve's rests
LEAST_TURNS = 100  # samples needed to decide whether the reading has noise
TIMES_USUAL, LEAST_MOVED = 4.0, 6.0  # OP moves so many times as far as in other rests; percent
# When the mismatch is explained.
LEAST_TURNS_EXPLAINED = 60
LONGER = 5.0  # times the usual long repeat of the reading, from which it is frozen
LASTING = (10.0, 90.0)  # percentiles of OP within a run
BAND_MARGIN, BAND_EXTRA = 1.5, 1.0  # times the stem's band, plus percent, that OP must move


def after_the_first(runs: Iterable[tuple[int, int]], samples: int) -> Bools:
    """(n,) True in ``runs``, [first, last) of each, but for the first sample of each, which is the
    last true one.
    """
    frozen = np.zeros(samples, dtype=bool)
    for first, last in runs:
        frozen[first + 1 : last] = True
    return frozen


def without_frozen(recording: Recording, frozen: Bools) -> Recording:
    """The recording with the position marked bad where it was ``frozen`` (n,): whatever is fitted
    to it then leaves these samples out, and sets the stem to its reading after them.
    """
    position = recording.mv
    if position is None or not frozen.any():
        return recording
    quality = np.where(frozen, np.uint8(Quality.BAD), position.quality)
    masked = replace(position, quality=quality)
    return replace(recording, signals={**recording.signals, Role.MV: masked})


def mostly_one_value(longest_repeat: int, samples: int) -> bool:
    """Whether a tag's longest exact repeat, of so many samples in all, is too long for a signal."""
    return longest_repeat >= max(SAMPLES_OF_A_TAG, SHARE_OF_A_TAG * samples)


def _long(length: NDArray[np.int64], interval_s: float) -> Bools:
    """(m,) which runs of ``length`` samples last too long for a reading with noise."""
    return np.asarray(length >= max(FROZEN_SAMPLES, round(FROZEN_S / interval_s)))


def frozen_runs(recording: Recording) -> list[tuple[int, int]]:
    """[first, last) of each run in which the position was frozen, as known before any fit.

    Where the reading has noise, any long exact repeat is frozen. A coarse reading repeats itself
    whenever the stem rests, so there a run counts only where OP moves four times as far as in the
    valve's other rests, each rest weighted by its length.
    """
    if recording.mv is None:
        return []
    mv, op = recording.mv.values, recording.op.values
    runs = equal_runs(mv)
    length = runs[:, 1] - runs[:, 0]
    runs, length = runs[length >= LEAST_REPEATS], length[length >= LEAST_REPEATS]
    long = _long(length, recording.interval_s)
    if not long.any():
        return []
    if not _noisy(mv, runs[long]):
        moved = ranges(op, runs)
        long &= moved > np.maximum(TIMES_USUAL * _usual_of_others(moved, length), LEAST_MOVED)
    return [(int(a), int(b)) for a, b in runs[long]]


def _noisy(mv: Floats, runs: NDArray[np.int64]) -> bool:
    """True where the reading, outside its long repeats, reverses at every other sample.

    A reading that seldom repeats itself at all has noise too, however fast the stem moves.
    """
    return repeat_share(mv) < MOST_REPEATS or turns_like_noise(mv, runs, LEAST_TURNS)


def _usual_of_others(moved: Floats, length: NDArray[np.int64]) -> Floats:
    """(m,) for each run the median of ``moved`` over the others, weighted by ``length``."""
    order = np.argsort(moved, kind="stable")
    total = np.cumsum(length[order])
    own_lengths = length[order]
    half = 0.5 * (total[-1] - own_lengths)
    before = np.searchsorted(total, half)
    after = np.searchsorted(total, half + own_lengths)
    middle = np.where(before < np.arange(order.size), before, np.minimum(after, order.size - 1))
    usual_length = np.empty(order.size)
    usual_length[order] = np.where(total[-1] > own_lengths, moved[order][middle], 0.0)
    return usual_length


def frozen_samples(
    op: Floats, mv: Floats, interval_s: float, *, compressed: bool, lines: Runs | None = None
) -> Bools:
    """(n,) True where the reading was frozen; the first sample of a run is its last true one.

    A run of exact repeats of at least 30 s is frozen where the reading shows noise everywhere else
    and never repeats itself for a fifth as long, or where OP moves within it by more than one and a
    half times the band in which friction could hold the stem, plus 1 %. Where the archive
    interpolated or held values (``compressed``), only the second test counts. Of an archive that
    drew lines, ``lines`` (m, 2) are those that are as good as flat, and stand for the repeats.
    """
    frozen = np.zeros(mv.size, dtype=bool)
    runs = equal_runs(mv) if lines is None else lines
    length = runs[:, 1] - runs[:, 0]
    long = _long(length, interval_s)
    if not long.any():
        return frozen
    outside = np.isfinite(mv) & np.isfinite(op)
    for first, last in runs[long]:
        outside[first + 1 : last] = False
    noisy = not compressed and turns_like_noise(mv, runs[long], LEAST_TURNS_EXPLAINED)
    usual_length = float(np.percentile(length[~long], 99.0)) if (~long).any() else 1.0
    band = _band(op, mv, outside)
    for first, last in runs[long]:
        by_noise = noisy and last - first >= LONGER * usual_length
        moved = op[first:last][np.isfinite(op[first:last])]
        # A move of OP that lasts a second or two is over before the stem can answer.
        op_range = float(np.ptp(np.percentile(moved, LASTING))) if moved.size else 0.0
        if by_noise or op_range > BAND_MARGIN * band + BAND_EXTRA:
            frozen[first + 1 : last] = True
    return frozen


def _band(op: Floats, mv: Floats, outside: Bools) -> float:
    """Range of OP over which the stem was seen not to follow, percent: of ``op - mv`` elsewhere."""
    if np.count_nonzero(outside) < LEAST_TURNS_EXPLAINED:
        return float("inf")
    low, high = np.percentile((op - mv)[outside], (2.0, 98.0))
    return float(high - low)
