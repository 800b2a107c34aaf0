"""Robust least squares by Levenberg and Marquardt, with differences in place of derivatives.

Levenberg (1944), doi:10.1090/qam/10666; Marquardt (1963), doi:10.1137/0111030.

With the breakaways assimilated, the residual of a run is nearly smooth in its parameters (only
single samples jump), so that a few dozen runs reach an optimum for which a population search needs
hundreds. The loss is Cauchy's, by reweighting; a breakaway's distance from its level is a residual
like any other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import Search
from stemwatch.models.mismatch.fit.evaluator import (
    CoordinateLayout,
    Evaluator,
    RunRequest,
    RunResults,
)
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.statistics.positive_definite import solve
from stemwatch.models.stickslip.onsets import Samples
from stemwatch.models.stickslip.search import SearchResult

DAMPING = (0.003, 0.1, 3.0)  # tried side by side in every round
_DAMPING = np.array(DAMPING)
SMALLEST_GAIN = 2e-3  # a round that lowers the loss by a smaller share is the last
# Differences wide enough that a single jumping sample does not dominate them.
_STEP_SHARE, _STEP_RANGE = 0.03, 0.004
_BASE_STEPS = np.array([0.02, 0.015, 0.04, 0.004, 0.04, 0.05])


def descend(
    evaluator: Evaluator, layout: CoordinateLayout, blocks: Bools, start: Floats, rounds: int
) -> Search[SearchResult]:
    """The candidate (size,) reached from ``start`` by at most ``rounds``; never worse than it."""
    if rounds <= 0:
        only = RunRequest(layout, start[None])
        yield [only]
        return SearchResult(start.copy(), float(evaluator.mean_loss(only.losses, blocks)[0]))
    seen = _Seen(*evaluator.scored_within(blocks))
    best = SearchResult(start.copy(), np.inf)
    low, high = layout.bounds.low, layout.bounds.high
    free = high > low
    # The speed of sticking again acts by a yes or no, so it has no useful derivative.
    free[base_coordinate.RESTICK] = False
    index = np.flatnonzero(free)
    for _ in range(rounds):
        slopes = _Slopes(evaluator, layout, seen, best.candidate, index)
        yield [slopes]
        current_loss = float(evaluator.mean_loss(slopes.losses[:1], blocks)[0])
        best = SearchResult(best.candidate, current_loss)
        trials = _trials(best.candidate, slopes.normal, slopes.slope, index, low, high, _DAMPING)
        trial = RunRequest(layout, trials)
        yield [trial]
        values = evaluator.mean_loss(trial.losses, blocks)
        i = int(np.argmin(values))
        gained = best.loss - float(values[i])
        if gained > 0.0:
            best = SearchResult(trial.candidates[i], float(values[i]))
        if gained <= SMALLEST_GAIN * best.loss:
            break
    return best


@dataclass(frozen=True)
class _Seen:
    """What a descent is fitted to: the scored ``samples`` (m,) of some blocks of time, and the
    breakaways (e,) on them: a run is early or late only where the recorded stem lets go."""

    samples: Samples
    events: Samples


@compiled()
def _moved(
    candidate: Floats, index: Samples, low: Floats, high: Floats, usual: Floats
) -> tuple[Floats, Floats]:
    """Steps (k,) of the differences along the coordinates ``index`` (k,), turned inwards at an
    upper limit, and (1 + k, size) the candidate and the candidate after each step.

    ``usual`` (6,) are the steps of the base's own coordinates.
    """
    steps = np.empty(index.size)
    moved = np.empty((index.size + 1, candidate.size))
    for row in range(index.size + 1):
        for j in range(candidate.size):
            moved[row, j] = candidate[j]
    for row in range(index.size):
        i = index[row]
        step = max(_STEP_SHARE * abs(candidate[i]), _STEP_RANGE * (high[i] - low[i]))
        if i < usual.size:
            step = usual[i]
        steps[row] = -step if candidate[i] + step > high[i] else step
        moved[row + 1, i] += steps[row]
    return steps, moved


@compiled()
def _residuals(
    simulated: Floats,
    first: int,
    mv: Floats,
    slack: Floats,
    samples: Samples,
    early_late: Floats,
    events: Samples,
    event_scale: float,
    rows: Floats,
) -> None:
    """Residuals at ``samples`` (m,), then at the breakaways ``events`` (e,), into ``rows``.

    Of the runs in the columns of ``simulated`` (n, lanes) from ``first`` on.
    """
    # Unsigned: the compiler need not ask whether an index counts from the end.
    begin = np.uint64(first)
    for i in range(np.uint64(samples.size)):
        k = np.uint64(samples[i])
        measured, free = mv[k], slack[k]
        for j in range(np.uint64(rows.shape[0])):
            residual = measured - simulated[k, begin + j]
            rows[j, i] = residual - min(max(residual, -free), free)
    for j in range(rows.shape[0]):
        for i in range(events.size):
            rows[j, samples.size + i] = early_late[j, events[i]] * event_scale


@compiled(error_model="numpy")  # a division that may raise is not vectorised
def _weighted(rows: Floats, steps: Floats, m: int, event: float, delta: float) -> None:
    """Rows (1 + k, m + e) of residuals, the first one's and after each step, to differences.

    Each becomes the derivative by its coordinate, negative, times the root of Cauchy's weight;
    from column ``m`` on they are breakaways, which count for ``event`` samples.
    """
    root = np.empty(rows.shape[1])
    for i in range(root.size):
        share = rows[0, i] / delta
        root[i] = np.sqrt((event if i >= m else 1.0) / (1.0 + share * share))
    for j in range(1, rows.shape[0]):
        for i in range(root.size):
            rows[j, i] = (rows[0, i] - rows[j, i]) / steps[j - 1] * root[i]
    for i in range(root.size):
        rows[0, i] *= root[i]


class _Slopes(RunRequest):
    """The runs of a candidate, and with a step along each free coordinate.

    The answer is the ``normal`` matrix (k, k) and the right-hand side ``slope`` (k,) over the free
    coordinates; residuals are not kept.
    """

    reads = True

    def __init__(
        self,
        evaluator: Evaluator,
        layout: CoordinateLayout,
        seen: _Seen,
        candidate: Floats,
        index: Samples,
    ) -> None:
        self.evaluator, self.seen = evaluator, seen
        low, high = layout.bounds.low, layout.bounds.high
        usual, wide = _BASE_STEPS.copy(), 0.01 * candidate[base_coordinate.S_PERCENT]
        usual[base_coordinate.S_PERCENT] = max(usual[base_coordinate.S_PERCENT], wide)
        self.steps, moved = _moved(candidate, index, low, high, usual)
        self.normal = self.slope = self._rows = np.empty((0, 0))
        super().__init__(layout, moved)

    def take(self, part: slice, runs: RunResults) -> None:
        """Losses and residuals of some of the runs; the last ones make the normal equations."""
        super().take(part, runs)
        evaluator, seen, count = self.evaluator, self.seen, self.candidates.shape[0]
        if part.start == 0:
            self._rows = np.empty((count, seen.samples.size + seen.events.size))
        _residuals(
            runs.simulated,
            runs.first,
            evaluator.problem.mv,
            evaluator.slack,
            seen.samples,
            runs.early_late,
            seen.events,
            evaluator.delta / evaluator.scatter,
            self._rows[part],
        )
        if part.stop == count:
            _weighted(self._rows, self.steps, seen.samples.size, evaluator.event, evaluator.delta)
            product = self._rows @ self._rows.T
            self.normal, self.slope = product[1:, 1:], product[1:, 0]
            self._rows = np.empty((0, 0))


@compiled()
def _trials(
    candidate: Floats,
    normal: Floats,
    slope: Floats,
    index: Samples,
    low: Floats,
    high: Floats,
    damping: Floats,
) -> Floats:
    """(dampings, size) where the damped steps lead: ``normal + damping diag(normal)`` times the
    step is ``slope``, over the coordinates ``index`` (k,), within the limits.
    """
    k = index.size
    floor = 0.0
    for i in range(k):
        floor = max(floor, normal[i, i])
    floor = 1e-9 * max(floor, 1e-12)
    trials = np.empty((damping.size, candidate.size))
    a, step = np.empty((k, k)), np.empty(k)
    for way in range(damping.size):
        for i in range(k):
            step[i] = slope[i]
            for j in range(k):
                a[i, j] = normal[i, j]
            a[i, i] += damping[way] * normal[i, i] + floor
        solve(a, step)
        for i in range(candidate.size):
            trials[way, i] = candidate[i]
        for i in range(k):
            trials[way, index[i]] += step[i]
        for i in range(candidate.size):
            trials[way, i] = min(max(trials[way, i], low[i]), high[i])
    return trials
