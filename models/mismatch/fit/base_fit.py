"""The base of every comparison: S, J and the reading's zero and gain, searched from many starts.

``naive`` is the usual fit of the literature: S and J alone, gain 1 and zero 0, no delay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import Search, conclude
from stemwatch.models.mismatch.fit.crossfit import (
    CAREFUL,
    FitEffort,
    Fitted,
    crossfit,
    gain,
    refit,
    search,
)
from stemwatch.models.mismatch.fit.evaluator import (
    CoordinateLayout,
    Evaluator,
    TermSet,
    make_evaluator,
)
from stemwatch.models.mismatch.term import RecordingSummary
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals.forensics import repeat_share
from stemwatch.models.stickslip.evaluator import CANONICAL, ONLY_WHEN_TURNING
from stemwatch.models.stickslip.fit import COARSE_COMMAND
from stemwatch.models.stickslip.parameters import Bounds
from stemwatch.models.stickslip.problem import FitProblem

RATIOS = (0.0, 0.15, 0.35, 0.6, 0.85, 1.15)
WIDTHS = 16
RESTICKS = (0.0, 0.05, 0.4)  # percent per second
# A stem that slips beyond its command rests there until the command has come past it again.
BEYOND_COMMAND = (0.85, 1.15, 1.4)  # J/S
# A command is sampled somewhere between two scans; more than this is a dead time.
WITHIN_SAMPLE = 0.6
FIRST_SCATTER = 0.08  # of the level (S + J)/2
ZERO_REACH = 8.0  # percent either way
HELD = 0.3  # percent
GAIN_REACH = (-0.25, 0.3)
RESTICK_REACH = 4.0  # percent per second; from there on a stem sticks at every sample
CLEARLY = 0.97  # share of the loss that another reading, or a stem that sticks again, must reach
LEAST_DELTA = 0.05  # percent
FIRST_OF_DRAWN = (
    0.5  # percent; an archive that drew lines leaves too little to estimate a wider scale
)
LEAST_SCATTER = 0.03  # percent
SCATTER_REACH = (0.03, 0.09)  # of the level
FEWEST_BREAKAWAYS = 8
NAIVE = FitEffort(keep=2, rounds=4, population=32, width=0.02)
# A stem that sticks again soon is at first fitted by one that slides: a wider S and a smaller J
# give the same breakaway, and no speed of sticking again beside these is better. Of 32 such valves
# (`prove --effect low_speed_restick`, seed 4034) the search ended there on eight.
SPEEDS = (0.25, 0.5, 1.0, 2.0)  # percent per second
FROM_S_TO_J = (0.04, 0.08, 0.16)  # share of S by which S is less, and J more
AGAIN = FitEffort(keep=3, rounds=10, first=((2, 2, np.inf),))


@dataclass(frozen=True)
class BaseFit:
    """The evaluator, scaled, and the base fitted on both folds; and the same of a stem that sticks
    again, where that fits unseen blocks clearly better."""

    evaluator: Evaluator
    fitted: Fitted
    sticks_again: BaseFit | None = None


def base_bounds(
    problem: FitProblem, summary: RecordingSummary, *, own_reading: bool = True
) -> Bounds:
    """Limits of S, J/S, zero, gain - 1, the delay within a sample and the speed of sticking.

    Without a reading of its own (a flow that was read through a characteristic) zero and gain are
    part of that characteristic and held.
    """
    reach = max(1.2 * summary.swing, 2.0)
    late = WITHIN_SAMPLE * problem.interval_s
    low = [0.0, 0.0, -ZERO_REACH, GAIN_REACH[0], 0.0, 0.0]
    high = [reach, 1.5, ZERO_REACH, GAIN_REACH[1], late, RESTICK_REACH]
    if not own_reading:
        (
            low[base_coordinate.ZERO],
            high[base_coordinate.ZERO],
            low[base_coordinate.GAIN],
            high[base_coordinate.GAIN],
        ) = -HELD, HELD, 0.0, 0.0
    return Bounds(np.array(low), np.array(high))


def grid(summary: RecordingSummary, zero: float, resticks: tuple[float, ...] = (0.0,)) -> Floats:
    """(m, 6) S, J/S and the reading's zero, with and without the one that the loop suggests, and
    speeds below which the stem sticks again.
    """
    widths = max(1.2 * summary.swing, 2.0) * np.linspace(0.02, 1.0, WIDTHS) ** 1.8
    zeros = np.unique([0.0, zero])
    parts = np.array(np.meshgrid(widths, RATIOS, zeros, resticks, indexing="ij"))
    rows = np.zeros((parts[0].size, base_coordinate.N_BASE))
    rows[
        :,
        [
            base_coordinate.S_PERCENT,
            base_coordinate.RATIO,
            base_coordinate.ZERO,
            base_coordinate.RESTICK,
        ],
    ] = parts.reshape(4, -1).T
    return rows


def beyond_command(summary: RecordingSummary, zero: float) -> Floats:
    """(m, 6) starts of a stem whose slips end beyond the command (J near S or above) and that
    sticks after each of them; without these, a stretched reading stands in for it."""
    rows = grid(summary, zero, (RESTICK_REACH,))
    rows = rows[rows[:, base_coordinate.RATIO] == RATIOS[0]].repeat(len(BEYOND_COMMAND), 0)
    rows[:, base_coordinate.RATIO] = np.tile(BEYOND_COMMAND, rows.shape[0] // len(BEYOND_COMMAND))
    return np.asarray(rows)


def sticking_again(layout: CoordinateLayout, candidates: Floats) -> list[Floats]:
    """Variants of ``candidates`` (m, size), each (m, size): a stem that sticks again at a speed,
    with S less and J more by as much, so that it breaks away where it did."""
    variants = []
    for speed in SPEEDS:
        for share in FROM_S_TO_J:
            variant = candidates.copy()
            S = candidates[:, base_coordinate.S_PERCENT]
            variant[:, base_coordinate.S_PERCENT] = (1.0 - share) * S
            ratio = (candidates[:, base_coordinate.RATIO] + share) / (1.0 - share)
            variant[:, base_coordinate.RATIO] = ratio
            variant[:, base_coordinate.RESTICK] = speed
            variants.append(layout.bounds.clip(variant))
    return variants


def suggested_zero(problem: FitProblem) -> float:
    """Friction holds the stem in a band that is as wide above the command as below, percent."""
    ahead = (problem.mv - problem.op)[problem.scored]
    low, high = np.percentile(ahead, (2.0, 98.0))
    return 0.5 * float(low + high)


def scale(evaluator: Evaluator, simulated: Floats) -> float:
    """Scale of the robust loss: three times the noise or the bulk of the residual, percent."""
    problem = evaluator.problem
    residual = evaluator.residual(simulated)[evaluator.measured]
    spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    return max(3.0 * problem.sigma, spread, LEAST_DELTA)


def first_scatter(summary: RecordingSummary) -> float:
    """Scatter of the breakaway level before the stem has been fitted, percent: a share of the stick
    band, which is taken as a third of OP's swing.
    """
    return FIRST_SCATTER * max(summary.swing / 6.0, 0.5)


def breakaway_scatter(early_late: Floats, level: float, sigma: float) -> float:
    """Standard deviation of the breakaway level, percent, from how far each one came from it."""
    seen = early_late[early_late != 0.0]
    if seen.size < FEWEST_BREAKAWAYS:
        return max(FIRST_SCATTER * level, sigma, LEAST_SCATTER)
    spread = 1.4826 * float(np.median(np.abs(seen)))
    low, high = SCATTER_REACH
    return max(min(max(spread, low * level), high * level), sigma, LEAST_SCATTER)


def fit_base(
    problem: FitProblem,
    summary: RecordingSummary,
    slack: Floats | None = None,
    *,
    own_reading: bool = True,
) -> BaseFit:
    """The base fitted on both folds, with the speed at which a moving stem sticks again and the
    scale of the loss.
    """
    spread = float(np.std(problem.mv[problem.scored]))
    first = max(3.0 * problem.sigma, 0.1 * spread, LEAST_DELTA)
    if slack is not None and slack.any():
        first = min(first, FIRST_OF_DRAWN)
    bounds = base_bounds(problem, summary, own_reading=own_reading)
    evaluator = make_evaluator(
        problem, summary, bounds, first, CANONICAL, first_scatter(summary), slack
    )
    zero = suggested_zero(problem)
    usual_candidates = bounds.clip(grid(summary, zero, RESTICKS))
    starts = np.vstack((usual_candidates, bounds.clip(beyond_command(summary, zero))))
    readings = [evaluator]
    if repeat_share(problem.op) >= COARSE_COMMAND:
        readings.append(replace(evaluator, restick=ONLY_WHEN_TURNING, _layouts={}))
    all_blocks = np.ones(problem.n_blocks, dtype=bool)
    fits = [
        conclude(reading, search(reading, reading.layout(TermSet()), all_blocks, starts, CAREFUL))
        for reading in readings
    ]
    best = int(np.argmin([fit.loss for fit in fits]))
    if fits[best].loss >= CLEARLY * fits[0].loss:
        best = 0
    chosen = readings[best]
    layout = chosen.layout(TermSet())
    simulated, early_late = chosen.assimilated(layout, fits[best].candidate)
    delta = min(scale(chosen, simulated), 3.0 * first)
    level = (
        0.5
        * fits[best].candidate[base_coordinate.S_PERCENT]
        * (1.0 + fits[best].candidate[base_coordinate.RATIO])
    )
    scatter = breakaway_scatter(early_late, float(level), problem.sigma)
    chosen = replace(chosen, delta=delta, scatter=scatter, _layouts={})
    layout = chosen.layout(TermSet())
    stride = 1 if chosen.slack.any() else max(usual_candidates.shape[0] // 60, 1)
    near_candidates = np.vstack((usual_candidates[::stride], fits[best].candidate))
    fitted = conclude(chosen, crossfit(chosen, layout, near_candidates, CAREFUL))
    again = conclude(
        chosen, refit(chosen, fitted, AGAIN, *sticking_again(layout, fitted.candidates))
    )
    sticks_again = None
    if gain(chosen, fitted, again).mean > -math.log(CLEARLY):
        sticks_again = BaseFit(_summarised(chosen, again), again)
    return BaseFit(_summarised(chosen, fitted), fitted, sticks_again)


def _summarised(evaluator: Evaluator, fitted: Fitted) -> Evaluator:
    """The evaluator with S and J of a base fit in its summary."""
    seen = fitted.candidates.mean(axis=0)
    S = float(seen[base_coordinate.S_PERCENT])
    summary = replace(evaluator.summary, S=S, J=S * float(seen[base_coordinate.RATIO]))
    return replace(evaluator, summary=summary, _layouts={})


def naive_evaluator(evaluator: Evaluator) -> Evaluator:
    """The evaluator for S and J fitted as usual: free runs, resynchronised at each block of time
    only.
    """
    return replace(evaluator, window=0.0, restick=CANONICAL, _layouts={})


def fit_naive(evaluator: Evaluator, blocks: Bools) -> Search[Floats]:
    """(6,) S and J alone: gain 1, zero 0, no delay, fitted to ``blocks`` of a naive evaluator."""
    layout = naive_layout(evaluator)
    starts = layout.bounds.clip(grid(evaluator.summary, 0.0))
    fit = yield from search(evaluator, layout, blocks, starts, NAIVE)
    fit = yield from search(evaluator, layout, blocks, fit.candidate[None, :], NAIVE)
    return fit.candidate


def naive_layout(evaluator: Evaluator) -> CoordinateLayout:
    """The base with its reading and its delay held at neutral."""
    layout = evaluator.layout(TermSet())
    low, high = layout.bounds.low.copy(), layout.bounds.high.copy()
    low[base_coordinate.ZERO] = high[base_coordinate.ZERO] = low[base_coordinate.GAIN] = high[
        base_coordinate.GAIN
    ] = 0.0
    high[base_coordinate.DELAY] = high[base_coordinate.RESTICK] = 0.0
    return replace(layout, bounds=Bounds(low, high))
