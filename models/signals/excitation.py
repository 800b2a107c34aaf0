"""How much a signal moves: reversals, travel, swing, slips, time at its limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.signals.kept_of_array import kept_of_array
from stemwatch.models.signals.runs_of_samples import runs_of
from stemwatch.models.statistics.quantiles import percentiles

REST_SAMPLES = 3  # before a jump
LIMIT_MARGIN = 5.0  # percent by which an output may be driven beyond 0 and 100
LIMIT_TOLERANCE = 1e-6  # percent


@compiled()
def _turning_points(values: Floats, threshold: float, out: NDArray[np.int64]) -> int:
    """Zigzag: indices of extremes that are followed by a move of at least ``threshold``."""
    count = high = low = direction = 0
    for k in range(1, values.size):
        if direction >= 0 and values[k] > values[high]:
            high = k
        if direction <= 0 and values[k] < values[low]:
            low = k
        if direction >= 0 and values[high] - values[k] >= threshold:
            if direction > 0:
                out[count] = high
                count += 1
            direction, low = -1, k
        elif direction <= 0 and values[k] - values[low] >= threshold:
            if direction < 0:
                out[count] = low
                count += 1
            direction, high = 1, k
    return count


def reversals(values: Floats, threshold: float) -> NDArray[np.int64]:
    """Indices at which ``values`` (n,), finite, reverses by at least ``threshold``.

    Noise smaller than the threshold makes no reversal.
    """
    out = np.empty(values.size, dtype=np.int64)
    count = _turning_points(np.ascontiguousarray(values), max(threshold, 1e-12), out)
    return np.asarray(out[:count])


def travel(values: Floats, threshold: float) -> float:
    """Sum of the moves between reversals, in the unit of ``values``: wear, without the noise."""
    if values.size < 2:
        return 0.0
    turns = reversals(values, threshold)
    points = np.concatenate((values[:1], values[turns], values[-1:]))
    moves = np.abs(np.diff(points))
    return float(moves[moves >= threshold].sum())


@dataclass(frozen=True)
class Jumps:
    """Jumps of the stem from rest: where each begins, and how far it goes, percent, with its sign.

    A jump is a run of steps beyond ``5 sqrt(2) sigma`` whose first step is three times OP's own,
    after at least three samples of rest. A valve that follows a quick command smoothly has none.
    """

    begins: NDArray[np.int64]  # (m,) last sample of rest
    sizes: Floats  # (m,)

    @property
    def count(self) -> int:
        """How many jumps there are."""
        return int(self.begins.size)


def jumps_from_rest(mv: Floats, op: Floats, sigma: float) -> Jumps:
    """The slips of a position (n,), finite, under a command (n,); ``sigma`` is MV's noise."""
    steps = np.abs(np.diff(mv))
    moved = steps > 5.0 * np.sqrt(2.0) * max(sigma, 1e-6)
    begins, ends = runs_of(moved).T
    rest_samples = begins - np.concatenate(([0], ends[:-1])) if begins.size else begins
    op_steps = np.abs(np.diff(op))
    # The command may have moved a sample before the stem shows it.
    op_steps[1:] = np.maximum(op_steps[1:], op_steps[:-1])
    jump = (rest_samples >= REST_SAMPLES) & (steps[begins] > 3.0 * op_steps[begins])
    return Jumps(begins=begins[jump], sizes=np.asarray((mv[ends] - mv[begins])[jump]))


@kept_of_array
def swing(values: Floats) -> float:
    """Range from the 1st to the 99th percentile, ignoring NaN; 0 where nothing is finite."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0
    low, high = percentiles(finite, (1.0, 99.0))
    return high - low


def ranges(values: Floats, runs: NDArray[np.int64]) -> Floats:
    """(m,) highest less lowest of ``values`` (n,) within each of ``runs`` (m, 2).

    A run is given by its first sample and its last + 1; runs may overlap. NaN is ignored; a run of
    NaN alone has the range NaN.
    """
    # ``reduceat`` works from each edge to the next, so every other result is a run. One sample is
    # appended for a run that ends with the signal.
    edges, padded = runs.ravel(), np.append(values, np.nan)
    high, low = (f.reduceat(padded, edges)[::2] for f in (np.fmax, np.fmin))
    return np.asarray(high - low)


def at_limits(op: Floats) -> tuple[float, float]:
    """Shares of the samples of an OP in percent that rest on its lower and on its upper limit.

    A limited output stays exactly at its lowest (highest) value, at or slightly beyond 0 % (100 %).
    A value below zero is not a limit by itself: a centred record is below zero half of the time.
    """
    finite = op[np.isfinite(op)]
    if not finite.size:
        return 0.0, 0.0
    low, high = float(finite.min()), float(finite.max())
    at_low = -LIMIT_MARGIN <= low <= 0.0
    at_high = 100.0 <= high <= 100.0 + LIMIT_MARGIN
    return (
        float(np.mean(finite <= low + LIMIT_TOLERANCE)) if at_low else 0.0,
        float(np.mean(finite >= high - LIMIT_TOLERANCE)) if at_high else 0.0,
    )
