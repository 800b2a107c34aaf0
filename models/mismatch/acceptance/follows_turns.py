"""Whether a spring with hysteresis stands behind what looks like a straight line of the reading.

A spring or diaphragm with inner friction resists each turn, by ``H h`` percent of span:
``dh = (dx - |dx| h) / w`` (Dahl 1968), ``h`` from -1 to 1, reached within some times ``w`` percent
of travel. Short moves come out too short, as with a span error, but long ones do not. Where the
term of that name (``terms.spring_hysteresis``, by another law of friction) is not found, a span
error or a zero error must not stand in for it.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.mismatch.fit.crossfit import Fitted, folds, robust_coefficients
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.advantage import Advantage, advantage

SPRING = "spring_hysteresis"  # its term
WAYS = (3.0, 6.0, 12.0)  # ``w`` that are tried, percent of travel
# What takes its place: errors of the reading, and play.
IMITATED = ("zero_shift", "span_error", "bowed_linkage", "lost_motion")
# Least mean log ratio of the losses and least t of what is left, and least swing of it, percent of
# span. Of five valves whose spring was taken for a span error, or for play, none leaves less than
# 0.06 (t 1.0) and 0.5 %, of eight with a span error none more than 0.01 (t 0.3) but for one, with a
# swing of 0.02 %: seed 4060, development.
LEAST_MEAN, LEAST_T, LEAST_SWING_PERCENT = 0.04, 0.8, 0.3
FEWEST = 30  # samples of a fold that show anything


@compiled()
def turned(x: Floats, way: float) -> Floats:
    """(n,) ``h`` along the places ``x`` (n,) of the stem, percent; 0 at the first."""
    h = np.zeros(x.size)
    for k in range(1, x.size):
        step = x[k] - x[k - 1]
        side = 1.0 if step > 0.0 else -1.0
        h[k] = side + (h[k - 1] - side) * np.exp(-abs(step) / way)
    return h


def follows_turns(evaluator: Evaluator, fitted: Fitted, least_t: float = LEAST_T) -> bool:
    """True where ``fitted`` leaves what a spring with hysteresis would, and that is material and
    beyond chance by ``least_t``.

    Of a compressing archive most kept values are of moves. A slip that comes a little early or late
    leaves there up to what such an archive keeps open, either way, and that follows the turns too.
    """
    left, swing_percent = hysteresis_left(evaluator, fitted)
    least_swing = max(LEAST_SWING_PERCENT, 2.0 * float(evaluator.slack.max()))
    return left.mean >= LEAST_MEAN and left.t >= least_t and swing_percent >= least_swing


def hysteresis_left(evaluator: Evaluator, fitted: Fitted) -> tuple[Advantage, float]:
    """How much better unseen blocks are predicted with a part of ``h`` added to the reading, and
    how far that part swings, 2nd to 98th percentile, percent of span.

    A constant and the ``h`` of three ways are fitted to the residual of each fold's fit, robustly,
    and added on the other fold.
    """
    block, scale = evaluator.problem.block, evaluator.delta
    before, after = np.zeros(evaluator.problem.n_blocks), np.zeros(evaluator.problem.n_blocks)
    swings = [0.0]
    for candidate, fold in zip(fitted.candidates, folds(evaluator), strict=True):
        simulated, _ = evaluator.assimilated(fitted.layout, candidate)
        residual = evaluator.residual(simulated)
        columns = np.stack([np.ones(simulated.size), *(turned(simulated, way) for way in WAYS)], -1)
        seen = evaluator.measured & fold[np.maximum(block, 0)]
        unseen = evaluator.measured & ~seen
        if np.count_nonzero(seen) < FEWEST:
            continue
        added = columns[unseen] @ robust_coefficients(columns[seen], residual[seen], scale)
        swings.append(float(np.ptp(np.percentile(added, (2.0, 98.0)))))
        for sums, error in ((before, residual[unseen]), (after, residual[unseen] - added)):
            loss = scale**2 * np.log1p((error / scale) ** 2)
            sums += np.bincount(block[unseen], loss, minlength=sums.size)
    return advantage(before, after, evaluator.measured_counts, scale), max(swings)
