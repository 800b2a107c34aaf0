"""Where the position reading was frozen: repeats to the last bit that friction cannot make."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.excitation import ranges
from stemwatch.models.forensics import repeat_share, turns_like_noise
from stemwatch.models.recording import Bools, Floats, Recording

FROZEN_S = 30.0  # a noisy transmitter does not repeat itself to the last bit for this long
FROZEN_SAMPLES = 20
MOST_REPEATS = 0.3  # a reading that repeats itself less often than this has noise
LEAST_TURNS = 100  # samples by which the noise is judged


def _run_edges(flags: Bools) -> NDArray[np.int64]:
    """(m, 2) first and last + 1 of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    return np.asarray(edges.reshape(-1, 2), dtype=np.int64)


def frozen_runs(recording: Recording) -> list[tuple[int, int]]:
    """Runs in which the position reading was frozen: bit-exact repeats that friction cannot make.

    Where the reading has noise, any long exact repeat is frozen. A coarse reading repeats itself
    whenever the stem rests, so there a run counts only while OP moves four times as far as in the
    valve's other rests, each rest weighed by how long it lasts.
    """
    if recording.mv is None:
        return []
    mv, op = recording.mv.values, recording.op.values
    same = np.concatenate(([False], np.diff(mv) == 0.0))
    runs = _run_edges(same) - (1, 0)  # the sample that is repeated belongs to the run
    length = runs[:, 1] - runs[:, 0]
    runs, length = runs[length > 3], length[length > 3]
    long = length >= max(FROZEN_SAMPLES, round(FROZEN_S / recording.interval_s))
    if not long.any():
        return []
    if not _noisy(mv, runs[long]):
        moved = ranges(op, runs)
        long &= moved > np.maximum(4.0 * _usual_of_others(moved, length), 6.0)
    return [(int(a), int(b)) for a, b in runs[long]]


def _noisy(mv: Floats, runs: NDArray[np.int64]) -> bool:
    """True where the reading, outside its long repeats, turns round at every other sample.

    A reading that seldom repeats itself at all has noise too, however fast the stem moves.
    """
    return repeat_share(mv) < MOST_REPEATS or turns_like_noise(mv, runs, LEAST_TURNS)


def _usual_of_others(moved: Floats, length: NDArray[np.int64]) -> Floats:
    """(m,) for each run the median of ``moved`` over the others, weighted by ``length``."""
    order = np.argsort(moved, kind="stable")
    total = np.cumsum(length[order])
    own = length[order]
    half = 0.5 * (total[-1] - own)
    before = np.searchsorted(total, half)
    after = np.searchsorted(total, half + own)
    place = np.where(before < np.arange(order.size), before, np.minimum(after, order.size - 1))
    usual = np.empty(order.size)
    usual[order] = np.where(total[-1] > own, moved[order][place], 0.0)
    return usual
