"""Cross-entropy search for the minimum of a loss with steps, all candidates in one kernel call.

The loss of a stick-slip model is piecewise smooth with steps (a slip happens one sample earlier or
later), so gradients are of no use. The cross-entropy method is Rubinstein's (1999,
doi:10.1023/A:1010091220143). Seeded: one recording gives one result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.parameters import Bounds

Loss = Callable[[Floats], Floats]  # (m, 9) candidates to (m,) losses


@dataclass(frozen=True)
class SearchResult:
    """The best candidate (9,) of a search and its loss."""

    candidate: Floats
    loss: float


def best_of(loss: Loss, candidates: Floats, keep: int = 1) -> list[SearchResult]:
    """The ``keep`` best of given candidates."""
    return by_loss(candidates, loss(candidates), keep)


def by_loss(candidates: Floats, losses: Floats, keep: int | None = None) -> list[SearchResult]:
    """Candidates (m, size) of given losses (m,), the best first, ``keep`` of them or all."""
    order = np.argsort(losses, kind="stable")[:keep]
    return [SearchResult(candidates[i].copy(), float(losses[i])) for i in order]


def refine(
    loss: Loss,
    start: Floats,
    spread: Floats,
    bounds: Bounds,
    rng: np.random.Generator,
    *,
    rounds: int = 8,
    population: int = 32,
) -> SearchResult:
    """Cross-entropy descent from ``start`` (9,); coordinates with zero ``spread`` stay fixed.

    Runs ``CrossEntropy`` with the losses given by ``loss``.
    """
    search = CrossEntropy(best_of(loss, start[None, :])[0], spread, bounds, rng)
    for _ in range(rounds):
        population_drawn = search.draw(population)
        search.learn(population_drawn, loss(population_drawn))
    return search.best


class CrossEntropy:
    """Cross-entropy descent from the candidate ``start``, one round at a time.

    Each round draws a population around the mean of the elite, keeps the best quarter, and
    narrows. ``best`` is the best candidate ever seen, so that it is never worse than the first.
    """

    def __init__(
        self, start: SearchResult, spread: Floats, bounds: Bounds, rng: np.random.Generator
    ) -> None:
        self.best = start
        self._spread, self._bounds, self._rng = spread, bounds, rng
        self._mean, self._width = start.candidate.copy(), spread.copy()

    def draw(self, population: int) -> Floats:
        """(population, size) candidates, the best one among them."""
        normal_draws = self._rng.standard_normal((population, self._mean.size))
        population_drawn = self._bounds.clip(self._mean + self._width * normal_draws)
        population_drawn[0] = self.best.candidate
        return population_drawn

    def learn(self, population_drawn: Floats, losses: Floats) -> None:
        """Update mean and width by the losses (m,) of the candidates ``population_drawn`` (m,
        size)."""
        order = np.argsort(losses, kind="stable")
        if losses[order[0]] < self.best.loss:
            self.best = SearchResult(population_drawn[order[0]].copy(), float(losses[order[0]]))
        elite = population_drawn[order[: population_drawn.shape[0] // 4]]
        mean = self._mean = 0.5 * self.best.candidate + 0.5 * elite.mean(axis=0)
        # The elite's spread about the best, a little widened, so that the search does not stall
        # on one side of a step.
        scatter = np.sqrt(np.mean((elite - mean) ** 2, axis=0))
        self._width = np.where(self._spread > 0.0, np.minimum(1.2 * scatter, self._width), 0.0)
