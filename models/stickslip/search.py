"""Minimising a rough, cheap loss: a cross-entropy search whose candidates share one kernel call.

The loss of a stick-slip model is piecewise smooth with steps (a slip happens one sample earlier or
later), so gradients are useless and a population is not. Seeded: the same result twice.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
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
    return ordered(candidates, loss(candidates))[:keep]


def ordered(candidates: Floats, losses: Floats) -> list[Found]:
    """Candidates (m, size) of given losses (m,), the best first."""
    order = np.argsort(losses, kind="stable")
    return [Found(candidates[i].copy(), float(losses[i])) for i in order]


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

    See ``refining``, which is answered with ``loss`` here.
    """
    begun = best_of(loss, start[None, :])[0]
    search = refining(begun, spread, bounds, rng, rounds=rounds, population=population)
    try:
        drawn = next(search)
        while True:
            drawn = search.send(loss(drawn))
    except StopIteration as end:
        found: Found = end.value
        return found


def refining(
    begun: Found,
    spread: Floats,
    bounds: Bounds,
    rng: np.random.Generator,
    *,
    rounds: int,
    population: int,
) -> Generator[Floats, Floats, Found]:
    """Cross-entropy descent that hands out each population (m, size) and waits for its losses (m,).

    Each round draws a population around the mean of the elite, keeps the best quarter, and
    narrows. The best candidate ever seen is returned, so the result is never worse than what it
    ``begun`` with.
    """
    best = begun
    mean, width = best.candidate.copy(), spread.copy()
    for _ in range(rounds):
        drawn = bounds.clip(mean + width * rng.standard_normal((population, mean.size)))
        drawn[0] = best.candidate
        values = yield drawn
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
