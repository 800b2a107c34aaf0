"""Whether what a model leaves is bent over the stroke, which no zero and no span explains.

A linkage that is bowed, or a scale that is not even, looks like a straight line over a part of the
stroke. What the line leaves tells the two apart: a zero or span error leaves nothing that follows
the travel.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch.crossfit import Fitted, folds
from stemwatch.models.mismatch.evaluator import Evaluator
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip.fit import Advantage, advantage

DEGREE = 3  # of the bend
ROUNDS = 3  # of reweighting
FEWEST = 30  # samples that show a bend


def curvature(evaluator: Evaluator, fitted: Fitted) -> Advantage:
    """How much better unseen blocks are predicted by a reading that is bent over the stroke.

    A cubic of the travel is fitted to the residual of each fold's fit and added on the other fold.
    """
    block = evaluator.problem.block
    before, after = np.zeros(evaluator.problem.n_blocks), np.zeros(evaluator.problem.n_blocks)
    for candidate, fold, other in zip(
        fitted.candidates, folds(evaluator), reversed(folds(evaluator)), strict=True
    ):
        simulated, _ = evaluator.assimilated(fitted.layout, candidate)
        residual = evaluator.residual(simulated)
        seen, unseen = _inside(evaluator, fold), _inside(evaluator, other)
        curve = _curve(simulated[seen], residual[seen], simulated[unseen], evaluator.delta)
        for sums, left in ((before, residual[unseen]), (after, residual[unseen] - curve)):
            loss = evaluator.delta**2 * np.log1p((left / evaluator.delta) ** 2)
            sums += np.bincount(block[unseen], loss, minlength=sums.size)
    return advantage(before, after, evaluator.told, evaluator.delta)


def _inside(evaluator: Evaluator, fold: Bools) -> Bools:
    """(n,) the measured samples of a fold."""
    return np.asarray(evaluator.measured & fold[np.maximum(evaluator.problem.block, 0)])


def _curve(place: Floats, residual: Floats, at: Floats, delta: float) -> Floats:
    """(m,) the robust cubic of ``residual`` over ``place``, read at ``at``."""
    if place.size < FEWEST:
        return np.zeros(at.size)
    low, high = np.percentile(place, (2.0, 98.0))
    centre, half = 0.5 * (low + high), max(0.5 * (high - low), 1e-3)
    columns = np.polynomial.legendre.legvander(np.clip((place - centre) / half, -1, 1), DEGREE)
    weight: Floats = np.ones(place.size)
    found: Floats = np.zeros(DEGREE + 1)
    for _ in range(ROUNDS):
        weighted = columns * weight[:, None]
        solved = np.linalg.lstsq(weighted.T @ columns, weighted.T @ residual, rcond=None)
        found = np.asarray(solved[0], dtype=np.float64)
        weight = np.asarray(1.0 / (1.0 + ((residual - columns @ found) / delta) ** 2))
    there = np.polynomial.legendre.legvander(np.clip((at - centre) / half, -1, 1), DEGREE)
    return np.asarray(there @ found)
