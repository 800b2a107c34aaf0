"""Minimising a rough, cheap loss: a cross-entropy search whose candidates share one kernel call.

The loss of a stick-slip model is piecewise smooth with steps (a slip happens one sample earlier or
later), so gradients are useless and a population is not. Seeded: the same result twice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.parameters import Bounds

Loss = Callable[[Floats], Floats]  # (m, 9) candidates to (m,) losses


@dataclass(frozen=True)
class Found:
    """The best candidate (9,) of a search and its loss."""

    candidate: Floats
    loss: float


def best_of(loss: Loss, candidates: Floats, keep: int = 1) -> list[Found]:
    """The ``keep`` best of given candidates."""
    values = loss(candidates)
    order = np.argsort(values, kind="stable")[:keep]
    return [Found(candidates[i].copy(), float(values[i])) for i in order]


def refine(
    loss: Loss,
    start: Floats,
    spread: Floats,
    bounds: Bounds,
    rng: np.random.Generator,
    *,
    rounds: int = 8,
    population: int = 32,
) -> Found:
    """Cross-entropy descent from ``start`` (9,); coordinates with zero ``spread`` stay fixed.

    Each round draws a population around the mean of the elite, keeps the best quarter, and
    narrows. The best candidate ever seen is returned, so the result is never worse than the start.
    """
    mean, width = start.copy(), spread.copy()
    best = best_of(loss, start[None, :])[0]
    for _ in range(rounds):
        drawn = bounds.clip(mean + width * rng.standard_normal((population, start.size)))
        drawn[0] = best.candidate
        values = loss(drawn)
        order = np.argsort(values, kind="stable")
        if values[order[0]] < best.loss:
            best = Found(drawn[order[0]].copy(), float(values[order[0]]))
        elite = drawn[order[: population // 4]]
        mean = 0.5 * best.candidate + 0.5 * elite.mean(axis=0)
        # The elite's spread about the best, a little widened, so that the search does not stall
        # on one side of a step.
        scatter = np.sqrt(np.mean((elite - mean) ** 2, axis=0))
        width = np.where(spread > 0.0, np.minimum(1.2 * scatter, width), 0.0)
    return best
