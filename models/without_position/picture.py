"""The traces that show a suspicion: the element between OP and PV, and PV by both models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.without_position.hammerstein import (
    DELAYS,
    FOLDS,
    PAST,
    block_means,
    element,
    past_values,
)


@dataclass(frozen=True, kw_only=True)
class ElementTraces:
    """(n,) each, a value for each sample of the recording; NaN where there is none.

    ``stem`` is the fitted element's x in the unit of OP; ``linear`` and ``sticking`` are PV, one
    block ahead, as the linear model and the one with the element predict it on stretches that they
    were not fitted to.
    """

    stem: Floats
    linear: Floats
    sticking: Floats

    def part(self, first: int, last: int) -> ElementTraces:
        """Copies of samples ``first`` (inclusive) to ``last`` (exclusive)."""
        stem, linear, sticking = (
            trace[first:last].copy() for trace in (self.stem, self.linear, self.sticking)
        )
        return ElementTraces(stem=stem, linear=linear, sticking=sticking)


def element_traces(op: Floats, pv: Floats, block_length: int, S: float, J: float) -> ElementTraces:
    """The traces of ``op`` and ``pv`` (n,) with the element of ``S`` and ``J``, percent of OP, and
    models over blocks of ``block_length`` samples, each with the delay that it prefers."""
    stem = np.empty(op.size)
    element(op - op[0], S, J, stem)
    u, x, y = (block_means(values, block_length) for values in (op, stem, pv))
    y = y - y.mean()
    linear = _predicted(y, [u - u.mean()])
    sticking = _predicted(y, [u - u.mean(), x - x.mean()])

    def spread_out(blocks: Floats) -> Floats:
        values = np.full(op.size, np.nan)
        wide = np.repeat(blocks + float(np.mean(block_means(pv, block_length))), block_length)
        values[: wide.size] = wide
        return values

    return ElementTraces(
        stem=stem + op[0], linear=spread_out(linear), sticking=spread_out(sticking)
    )


def _predicted(y: Floats, inputs: list[Floats]) -> Floats:
    """(m,) ``y`` (m,) one block ahead from its past and that of ``inputs``, each fold by a fit to
    the others; NaN where there is no past."""
    first = PAST + DELAYS
    n = y.size - first
    fold = np.arange(n) * FOLDS // n
    fixed = [past_values(y, first, 0), np.ones((1, n)), np.linspace(-1.0, 1.0, n)[None]]
    best, least = np.full(n, np.nan), np.inf
    for delay in range(DELAYS):
        regressors = np.concatenate([*fixed, *(past_values(u, first, delay) for u in inputs)]).T
        predicted = np.empty(n)
        for fold_index in range(FOLDS):
            in_fold = fold == fold_index
            weights = np.linalg.lstsq(regressors[~in_fold], y[first:][~in_fold], rcond=None)[0]
            predicted[in_fold] = regressors[in_fold] @ weights
        loss = float(np.sum((predicted - y[first:]) ** 2))
        if loss < least:
            best, least = predicted, loss
    return np.concatenate([np.full(first, np.nan), best])
