"""Three hypotheses share one kernel and nest in one another, each searched for its best candidate:

- ``sticking``: S, J alone,
- ``actuator``: dead time, lag and speed limit without any friction,
- ``both``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.evaluator import StickSlipEvaluator
from stemwatch.models.stickslip.search import Loss, SearchResult, best_of, refine

SEED = 20051


@dataclass(frozen=True)
class FreeCoordinates:
    """A named set of free coordinates."""

    name: str
    free: tuple[int, ...]


STICKING = FreeCoordinates("sticking", coordinate.STICKING)
BOTH = FreeCoordinates("both", coordinate.STICKING + coordinate.ACTUATOR)


def fit_each(evaluator: StickSlipEvaluator, blocks: Bools, base: Floats) -> dict[str, SearchResult]:
    """The best candidate of each hypothesis on the chosen blocks."""
    loss = evaluator.loss(blocks)
    starts = best_of(loss, sticking_grid(evaluator, base), keep=4)
    sticking = search(evaluator, loss, starts, coordinate.STICKING, 0.06, 7)
    starts = best_of(loss, actuator_grid(evaluator, base), keep=2)
    actuator = search(evaluator, loss, starts, coordinate.ACTUATOR, 0.08, 8)
    starts = _both_starts(sticking, actuator, loss, evaluator)
    both = search(evaluator, loss, starts, BOTH.free, 0.06, 9)
    both = search(evaluator, loss, [both], BOTH.free, 0.02, 9)
    # For a fair comparison the simpler hypothesis restarts from the S and J of the richer one.
    of_sticking = [coordinate.S_PERCENT, coordinate.RATIO, coordinate.ZERO]
    candidate = sticking.candidate.copy()
    candidate[of_sticking] = both.candidate[of_sticking]
    restart = [SearchResult(candidate, np.inf)]
    restarted = search(evaluator, loss, restart, coordinate.STICKING, 0.03, 6)
    sticking = min(sticking, restarted, key=lambda fit: fit.loss)
    return {"sticking": sticking, "actuator": actuator, "both": both}


def _both_starts(
    sticking: SearchResult, actuator: SearchResult, loss: Loss, evaluator: StickSlipEvaluator
) -> list[SearchResult]:
    """Starts for the joint search: each part alone, and each with a grid over the other."""
    over_actuator = sticking_grid(evaluator, actuator.candidate)[1::4]  # with its own zero only
    over_sticking = _joint_grid(evaluator, sticking.candidate)
    return [
        sticking,
        actuator,
        *best_of(loss, over_actuator, keep=2),
        *best_of(loss, over_sticking, keep=2),
    ]


def search(
    evaluator: StickSlipEvaluator,
    loss: Loss,
    starts: list[SearchResult],
    free: tuple[int, ...],
    scale: float,
    rounds: int,
) -> SearchResult:
    """The best candidate that seeded searches over ``free`` find from ``starts``.

    ``scale`` is the width of the first round as a share of the bounds.
    """
    rng = np.random.default_rng(SEED)
    spread = evaluator.spread(free, scale)
    fits = [
        refine(loss, start.candidate, spread, evaluator.bounds, rng, rounds=rounds)
        for start in starts
    ]
    return min(fits, key=lambda fit: fit.loss)


def polish(
    evaluator: StickSlipEvaluator, blocks: Bools, start: Floats, hypothesis: str
) -> SearchResult:
    """Refit a chosen hypothesis to more blocks, starting from ``start``."""
    free = BOTH.free if hypothesis == "both" else coordinate.STICKING
    loss = evaluator.loss(blocks)
    searches = [
        search(evaluator, loss, [SearchResult(start, np.inf)], free, scale, 7)
        for scale in (0.05, 0.01)
    ]
    return min(searches, key=lambda fit: fit.loss)


def sticking_grid(evaluator: StickSlipEvaluator, base: Floats) -> Floats:
    """(m, 9) candidates over S, J/S and the reading's zero, around ``base``."""
    # Widths below the swing matter most, and a valve with a wide swing may have a small S.
    widths = evaluator.bounds.high[coordinate.S_PERCENT] * np.linspace(0.0, 1.0, 23) ** 1.6
    ratios = np.array([0.0, 0.15, 0.3, 0.45, 0.6, 0.8, 1.0, 1.3])
    zeros = evaluator.problem.swing * np.array([-0.06, 0.0, 0.06, 0.0])
    if evaluator.problem.mv_is_percent:
        zeros[3] = -base[coordinate.ZERO]  # a reading without an offset is tried as well
    grid = np.array(np.meshgrid(widths, ratios, zeros, indexing="ij")).reshape(3, -1).T
    candidates = np.tile(base, (grid.shape[0], 1))
    candidates[:, coordinate.S_PERCENT] = grid[:, 0]
    candidates[:, coordinate.RATIO] = grid[:, 1]
    candidates[:, coordinate.ZERO] += grid[:, 2]
    return candidates


def actuator_grid(evaluator: StickSlipEvaluator, base: Floats) -> Floats:
    """(m, 9) candidates over dead time, lag and slowness in each direction."""
    dt = evaluator.problem.interval_s
    dead_times = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 5.0]) * max(dt, 1.0)
    lags = np.array([0.0, 0.7, 1.5, 3.0, 6.0]) * max(dt, 1.0)
    slow = np.array([0.0, 0.1, 0.35, 1.0])
    grid = np.array(np.meshgrid(dead_times, lags, slow, slow, indexing="ij")).reshape(4, -1).T
    candidates = np.tile(base, (grid.shape[0], 1))
    candidates[:, coordinate.DEAD_TIME_S] = grid[:, 0]
    candidates[:, coordinate.LAG_UP_S] = candidates[:, coordinate.LAG_DOWN_S] = grid[:, 1]
    candidates[:, coordinate.SLOW_UP] = grid[:, 2]
    candidates[:, coordinate.SLOW_DOWN] = grid[:, 3]
    return evaluator.bounds.clip(candidates)


def _joint_grid(evaluator: StickSlipEvaluator, sticking: Floats) -> Floats:
    """(m, 9) candidates that replace part of the sticking by a lag and a dead time."""
    unit = max(evaluator.problem.interval_s, 1.0)
    widths = sticking[coordinate.S_PERCENT] * np.array([0.5, 0.75, 1.0])
    ratios = np.array([0.0, 0.2, 0.5, 1.0])
    lags = unit * np.array([0.7, 1.5, 3.0, 6.0])
    dead_times = unit * np.array([0.0, 1.0, 2.0])
    grid = np.array(np.meshgrid(widths, ratios, lags, dead_times, indexing="ij")).reshape(4, -1).T
    candidates = np.tile(sticking, (grid.shape[0], 1))
    candidates[:, coordinate.S_PERCENT] = grid[:, 0]
    candidates[:, coordinate.RATIO] = grid[:, 1]
    candidates[:, coordinate.LAG_UP_S] = candidates[:, coordinate.LAG_DOWN_S] = grid[:, 2]
    candidates[:, coordinate.DEAD_TIME_S] = grid[:, 3]
    return evaluator.bounds.clip(candidates)
