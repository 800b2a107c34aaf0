"""A model's parameters in the unit cube, and the search for the best of them.

Derivative-free and seeded: a Latin hypercube, then the cross-entropy descent of the stick-slip fit
from the best of it. Parameters that a model refuses have an infinite loss.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.parameters import Bounds
from stemwatch.models.stickslip.search import Loss, SearchResult, best_of, refine
from stemwatch.models.studies.literature.model import Parameter, ValveModel

SEED = 20051


@dataclass(frozen=True, kw_only=True)
class SearchEffort:
    """How many candidates are tried: ``first`` in the cube, then ``starts`` descents."""

    first: int
    starts: int
    rounds: int
    population: int
    cloud: int  # candidates from which intervals are drawn


QUICK = SearchEffort(first=600, starts=5, rounds=12, population=40, cloud=300)
SLOW = SearchEffort(first=96, starts=2, rounds=7, population=20, cloud=0)


@dataclass(frozen=True)
class Cube:
    """The model's parameters (k,) and the position's zero, each from 0 to 1.

    A friction level goes no further than 1.2 times the command's ``swing``: a wider band would
    never have been crossed. The zero lies within ``reach`` of ``zero``, percent.
    """

    model: ValveModel
    swing: float
    zero: float

    @property
    def reach(self) -> float:
        """How far the zero may lie from its first guess, percent."""
        return max(0.5 * self.swing, 3.0)

    @property
    def bounds(self) -> Bounds:
        """The unit cube: 0 and 1 for each parameter and for the zero."""
        size = len(self.model.parameters) + 1
        return Bounds(np.zeros(size), np.ones(size))

    def values(self, candidate: Floats) -> tuple[Floats, float]:
        """Parameters (k,) and zero of a point (k + 1,) of the cube."""
        pairs = zip(self.model.parameters, candidate[:-1].tolist(), strict=True)
        values = [_value(*self._ends(p), share, p.logarithmic) for p, share in pairs]
        return np.array(values), self.zero + self.reach * (2.0 * float(candidate[-1]) - 1.0)

    def point(self, parameters: Floats, zero: float) -> Floats:
        """The point (k + 1,) of parameters and zero, moved into the cube."""
        pairs = zip(self.model.parameters, parameters.tolist(), strict=True)
        shares = [_share(*self._ends(p), value, p.logarithmic) for p, value in pairs]
        shares.append(0.5 + 0.5 * (zero - self.zero) / self.reach)
        return np.asarray(np.clip(np.array(shares), 0.0, 1.0))

    def _ends(self, parameter: Parameter) -> tuple[float, float]:
        low, high = parameter.lower, parameter.upper
        if parameter.per_percent is None:
            return low, high
        most_value = parameter.per_percent * max(1.2 * self.swing, 2.0)
        return max(low, -0.5 * most_value), min(high, most_value)

    def hypercube(self, count: int, rng: np.random.Generator) -> Floats:
        """(count + 1, k + 1) points that fill the cube evenly, denser at small friction levels.

        The last is the model's defaults. Widths below the swing matter most, and a valve of a wide
        swing may still have a small S.
        """
        size = len(self.model.parameters) + 1
        strata = np.tile(np.arange(count), (size, 1))
        points = (rng.permuted(strata, axis=1).T + rng.random((count, size))) / count
        for index, parameter in enumerate(self.model.parameters):
            if parameter.per_percent is not None and parameter.lower >= 0.0:
                points[:, index] **= 1.6
        defaults = np.array([p.default for p in self.model.parameters])
        return np.vstack((points, self.point(defaults, self.zero)))


def _value(low: float, high: float, share: float, logarithmic: bool) -> float:
    if logarithmic:
        return float(low * (high / low) ** share)
    return low + (high - low) * share


def _share(low: float, high: float, value: float, logarithmic: bool) -> float:
    if logarithmic:
        return float(np.log(value / low) / np.log(high / low))
    return (value - low) / (high - low)


def loss_over(cube: Cube, loss_of_candidate: Callable[[Floats, float], float]) -> Loss:
    """Losses (m,) of candidates (m, k + 1); infinite where the model objects."""

    def loss_of(candidate: Floats) -> float:
        parameters, zero = cube.values(candidate)
        if cube.model.objection(parameters) is not None:
            return np.inf
        return loss_of_candidate(parameters, zero)

    return lambda candidates: np.array([loss_of(candidate) for candidate in candidates])


def search(cube: Cube, coarse: Loss, fine: Loss, effort: SearchEffort) -> SearchResult:
    """The best point of the cube by ``fine``, starting from the best ones by ``coarse``."""
    rng = np.random.default_rng(SEED)
    first = cube.hypercube(effort.first, rng)

    def descend(loss: Loss, starts: list[SearchResult], spread: float) -> list[SearchResult]:
        width = np.full(first.shape[1], spread)
        search_options = {"rounds": effort.rounds, "population": effort.population}
        fits = [
            refine(loss, s.candidate, width, cube.bounds, rng, **search_options) for s in starts
        ]
        return sorted(fits, key=lambda fit: fit.loss)

    by_short_runs = descend(coarse, best_of(coarse, first, keep=effort.starts), 0.08)
    # The best start by long runs is tried as well.
    starts = [*by_short_runs[:2], *best_of(fine, first)]
    ranked = descend(fine, starts, 0.03)
    return descend(fine, ranked[:1], 0.008)[0]
