"""Intervals of any model's parameters by the block bootstrap (``models.block_bootstrap``).

The squared residuals of every candidate of one cloud around the optimum are summed by block of
time.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.block_bootstrap import COVERAGE, block_weights, cheapest
from stemwatch.models.recording import Floats
from stemwatch.models.studies.literature.search import Cube

REPLICATES = 300
WIDTHS = (0.002, 0.008, 0.03)  # of the cloud, shares of a parameter's range
Limits = tuple[float | None, float | None]
Squares = Callable[[Floats, float], Floats]


def intervals(
    cube: Cube,
    best: Floats,
    squares: Squares,
    block: NDArray[np.int64],
    cloud: int,
    step: float,
) -> list[Limits]:
    """A 95 % interval of each parameter (k,), or (None, None) where ``cloud`` is 0.

    ``squares`` gives the squared residuals (m,) of parameters and zero, ``block`` (m,) the block of
    time of each, ``step`` the usual step of OP in percent. The interval is that of this record and
    this model: it does not cover the choice of the model.
    """
    size = len(cube.model.parameters)
    if not cloud:
        return [(None, None)] * size
    rng = np.random.default_rng(7)
    points = [best]
    for width in WIDTHS:
        drawn = best + width * rng.standard_normal((cloud // len(WIDTHS), size + 1))
        points += list(cube.bounds.clip(drawn))
    values, sums = _sums(cube, points, squares, block)
    counts = np.bincount(np.unique(block, return_inverse=True)[1])
    chosen = cheapest(values, sums, block_weights(counts, REPLICATES, rng), rng)
    chosen += _unseen(cube, step / np.sqrt(1.0 + counts.size), chosen.shape, rng)
    low, high = np.percentile(np.vstack((chosen, values[:1])), COVERAGE, axis=0)
    low = np.maximum(np.minimum(low, values[0]), [p.lower for p in cube.model.parameters])
    high = np.minimum(np.maximum(high, values[0]), [p.upper for p in cube.model.parameters])
    return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]


def _unseen(cube: Cube, step: float, shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
    """What no reweighting shows: a slip is seen at the next sample, after a ``step`` of OP."""
    worth = np.array([p.per_percent or 0.0 for p in cube.model.parameters])
    return np.asarray(step * worth * rng.uniform(-1.0, 1.0, shape))


def _sums(
    cube: Cube,
    points: list[Floats],
    squares: Squares,
    block: NDArray[np.int64],
) -> tuple[Floats, Floats]:
    """Parameters (m, k) of the points that the model takes, and their sums by block (m, b)."""
    numbers = np.unique(block, return_inverse=True)[1]
    values, sums = [], []
    for point in points:
        parameters, zero = cube.values(point)
        if cube.model.objection(parameters) is None:
            values.append(parameters)
            sums.append(np.bincount(numbers, weights=squares(parameters, zero)))
    return np.array(values), np.array(sums)
