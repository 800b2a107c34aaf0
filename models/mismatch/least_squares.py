"""Robust least squares by Levenberg and Marquardt, with differences in place of derivatives.

Levenberg (1944), doi:10.1090/qam/10666; Marquardt (1963), doi:10.1137/0111030.

With the breakaways assimilated, the residual of a run is nearly smooth in its parameters (what
jumps are single samples), so that a few dozen runs reach an optimum for which a population needs
hundreds. The loss is Cauchy's, by reweighting; a breakaway's distance from its level is a residual
like any other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from stemwatch.models.mismatch import evaluator as base_coordinate
from stemwatch.models.mismatch.batched_search import Search
from stemwatch.models.mismatch.evaluator import CoordinateLayout, Evaluator, RunRequest, RunResults
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip.onsets import Samples
from stemwatch.models.stickslip.search import SearchResult

DAMPING = (0.003, 0.1, 3.0)  # tried side by side in every round
_DAMPING = np.array(DAMPING)
SMALLEST_GAIN = 2e-3  # a round that lowers the loss by a smaller share is the last
# Differences wide enough that a sample which jumps does not rule them.
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
    seen = _seen(evaluator, blocks)
    best = SearchResult(start.copy(), np.inf)
    free = layout.bounds.high > layout.bounds.low
    free[base_coordinate.RESTICK] = (
        False  # a stem sticks or does not: there is nothing to differentiate
    )
    for _ in range(rounds):
        slopes = _Slopes(evaluator, layout, seen, best.candidate, free)
        yield [slopes]
        current_loss = float(evaluator.mean_loss(slopes.losses[:1], blocks)[0])
        best = SearchResult(best.candidate, current_loss)
        trial = RunRequest(
            layout, _trials(layout, best.candidate, slopes.normal, slopes.slope, free)
        )
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
    breakaways (e,) on them."""

    samples: Samples
    events: Samples


def _seen(evaluator: Evaluator, blocks: Bools) -> _Seen:
    """The samples of some blocks; a run is early or late only where the recorded stem lets go."""
    block = evaluator.within(blocks)
    at_onsets = evaluator.onsets.at[block[evaluator.onsets.at] >= 0]
    return _Seen(np.flatnonzero(block >= 0), at_onsets)


def _steps(layout: CoordinateLayout, candidate: Floats) -> Floats:
    """(size,) steps of the differences, turned inwards at an upper limit."""
    low, high = layout.bounds.low, layout.bounds.high
    steps = np.maximum(_STEP_SHARE * np.abs(candidate), _STEP_RANGE * (high - low))
    steps[: base_coordinate.N_BASE] = _BASE_STEPS
    steps[base_coordinate.S_PERCENT] = max(
        _BASE_STEPS[0], 0.01 * candidate[base_coordinate.S_PERCENT]
    )
    return np.where(candidate + steps > high, -steps, steps)


@njit(cache=True)
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
    for i in range(samples.size):
        k = samples[i]
        for j in range(rows.shape[0]):
            residual = mv[k] - simulated[k, first + j]
            rows[j, i] = residual - min(max(residual, -slack[k]), slack[k])
    for j in range(rows.shape[0]):
        for i in range(events.size):
            rows[j, samples.size + i] = early_late[j, events[i]] * event_scale


@njit(cache=True, error_model="numpy")  # a division that may raise is done one by one
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

    Answered with the ``normal`` matrix (k, k) and the right-hand side ``slope`` (k,) over the free
    coordinates; residuals are let go as soon as they are used.
    """

    reads = True

    def __init__(
        self,
        evaluator: Evaluator,
        layout: CoordinateLayout,
        seen: _Seen,
        candidate: Floats,
        free: Bools,
    ) -> None:
        self.evaluator, self.seen = evaluator, seen
        index = np.flatnonzero(free)
        self.steps = _steps(layout, candidate)[index]
        moved = candidate[None].repeat(index.size + 1, 0)
        moved[np.arange(1, index.size + 1), index] += self.steps
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


def _trials(
    layout: CoordinateLayout, candidate: Floats, normal: Floats, slope: Floats, free: Bools
) -> Floats:
    """(3, size) where the damped steps lead."""
    diagonal = np.diag(normal)
    floor = 1e-9 * max(float(diagonal.max(initial=0.0)), 1e-12)
    damped = normal[None].repeat(len(DAMPING), 0)
    # Every so many elements of a square matrix lie on its diagonal.
    damped.reshape(len(DAMPING), -1)[:, :: diagonal.size + 1] += (
        _DAMPING[:, None] * diagonal + floor
    )
    steps = np.linalg.solve(damped, slope[:, None])
    trials = candidate[None].repeat(len(DAMPING), 0)
    trials[:, free] += steps[:, :, 0]
    return layout.bounds.clip(trials)
