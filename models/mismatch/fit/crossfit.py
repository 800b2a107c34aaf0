"""Cross-fitting: each hypothesis is fitted twice, and judged on the blocks it was not fitted to.

Blocks of time alternate between two folds. A search sees one fold only; the score of a block comes
from the fit to the other one, as Chernozhukov and co-workers do (2018, doi:10.1111/ectj.12097).
Both folds, and all starting points of a search, advance together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import Search, run_together
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout, Evaluator, RunRequest, TermSet
from stemwatch.models.mismatch.fit.least_squares import descend
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip.advantage import Advantage, advantage
from stemwatch.models.stickslip.search import CrossEntropy, SearchResult, by_loss

SEED = 1977
BestOfFolds = tuple[list[SearchResult], list[SearchResult]]  # on the even and on the odd blocks


@dataclass(frozen=True)
class FitEffort:
    """How long a search goes on: starts kept, rounds of descent, then a population about the best.

    Each entry of ``first`` is (rounds, starts kept after them, largest loss over that without the
    term at which a start of one fold still goes on); the entries follow one another. After them the
    search ends where both folds' losses are more than ``no_better`` times those without the term.
    ``population`` candidates are drawn about the best, with ``width`` as a share of each range.
    """

    keep: int
    rounds: int
    first: tuple[tuple[int, int, float], ...] = ((2, 1, np.inf),)
    no_better: float = np.inf
    population: int = 0
    width: float = 0.01


# Of 2244 looks at a term on top of S and J (97 recordings of the blind trial, seeds 5151, 6161 and
# 7171) half end after the second round: none of the 176 whose gain was beyond the limits in the
# end, 10 of the 324 whose gain came near them (0.4 of them).
LOOK = FitEffort(keep=2, rounds=5, first=((1, 2, 1.28), (1, 1, 1.05)), no_better=1.0)
# On top of a term that is there already: of 2375 three in ten end, none of 135, 5 of 257. Where
# only the seven or the twelve best terms of the first look were looked at instead, one name more
# of 43 was lost (96 recordings of these seeds).
GLANCE = FitEffort(keep=1, rounds=5, first=((1, 1, 1.28), (1, 1, 1.05)), no_better=1.02)
CAREFUL = FitEffort(keep=3, rounds=10, first=((2, 2, np.inf),), population=24)
POLISH = FitEffort(keep=1, rounds=8, population=24, width=0.006)
POPULATION_ROUNDS = 2
RESTICKS = (0.0, 0.01, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 4.0)  # percent per second
AFTER_RESTICK = 4  # rounds of descent
DISAGREE = 0.1  # percent per second between the folds' speeds of sticking again
BEND_DEGREE = 3
BEND_SAMPLES = 30  # the fewest that show a bend
REWEIGHTINGS = 3  # of a robust linear fit


@dataclass(frozen=True)
class Fitted:
    """A hypothesis on both folds.

    ``candidates`` (2, size): fitted to the even and to the odd blocks; ``losses`` (2, n_blocks)
    the sums of the loss of all blocks by each.
    """

    layout: CoordinateLayout
    candidates: Floats
    losses: Floats

    @property
    def heldout(self) -> Floats:
        """(n_blocks,) the loss of each block by the fit that did not see it."""
        is_odd = np.arange(self.losses.shape[1]) % 2 == 1
        return np.asarray(np.where(is_odd, self.losses[0], self.losses[1]))

    @property
    def slugs(self) -> tuple[str, ...]:
        """The slugs of the terms that were fitted, in the order of the chain."""
        return self.layout.hypothesis.slugs

    def values(self, slug: str) -> Floats:
        """(2, k) the coordinates of one term on both folds."""
        return np.asarray(self.candidates[:, self.layout.places[slug]])


def folds(evaluator: Evaluator) -> tuple[Bools, Bools]:
    """Even and odd blocks of time."""
    even = np.arange(evaluator.problem.n_blocks) % 2 == 0
    return even, ~even


def search(
    evaluator: Evaluator, layout: CoordinateLayout, blocks: Bools, starts: Floats, effort: FitEffort
) -> Search[SearchResult]:
    """The best candidate on ``blocks`` that is found from ``starts`` (m, size). Seeded."""
    begun = yield from _cheapest(evaluator, layout, blocks, starts, effort.keep)
    first = yield from _first_rounds(evaluator, layout, blocks, begun, effort)
    best = yield from _to_the_end(evaluator, layout, blocks, first.reached, effort, first.left)
    return best


def _cheapest(
    evaluator: Evaluator, layout: CoordinateLayout, blocks: Bools, candidates: Floats, keep: int
) -> Search[list[SearchResult]]:
    """The ``keep`` best on ``blocks`` of candidates (m, size), the best first."""
    request = RunRequest(layout, candidates)
    yield [request]
    return by_loss(candidates, evaluator.mean_loss(request.losses, blocks), keep)


class _FirstRounds(NamedTuple):
    """The starts that go on after the first rounds, the best first, and the rounds that are
    ``left``: 0 where the loss shows that the search would find nothing.
    """

    reached: list[SearchResult]
    left: int


def _first_rounds(
    evaluator: Evaluator,
    layout: CoordinateLayout,
    blocks: Bools,
    starts: list[SearchResult],
    effort: FitEffort,
    simple: float = np.inf,
) -> Search[_FirstRounds]:
    """The first rounds from ``starts``; ``simple`` is the loss of a poorer hypothesis."""
    reached, left = starts, effort.rounds
    for rounds, go_on, hopeless in effort.first if len(starts) > 1 or np.isfinite(simple) else ():
        reached = yield from _descended(evaluator, layout, blocks, reached, rounds)
        if reached[0].loss > hopeless * simple:
            return _FirstRounds(reached, 0)
        reached, left = reached[:go_on], left - rounds
    return _FirstRounds(reached, left)


def _to_the_end(
    evaluator: Evaluator,
    layout: CoordinateLayout,
    blocks: Bools,
    starts: list[SearchResult],
    effort: FitEffort,
    rounds: int,
) -> Search[SearchResult]:
    """The best that is found from ``starts`` by the last ``rounds`` and what comes after them."""
    if rounds == 0:
        return starts[0]
    ends = yield from _descended(evaluator, layout, blocks, starts, rounds)
    # Done for every hypothesis: an effect that delays the command fits only with another speed of
    # sticking again.
    best = yield from _resticking(evaluator, layout, blocks, ends[0])
    if effort.population:
        best = yield from _around(evaluator, layout, blocks, best, effort)
    return best


def _descended(
    evaluator: Evaluator,
    layout: CoordinateLayout,
    blocks: Bools,
    starts: list[SearchResult],
    rounds: int,
) -> Search[list[SearchResult]]:
    """The results of a descent from each of ``starts``, the best first."""
    descended = yield from run_together(
        descend(evaluator, layout, blocks, start.candidate, rounds) for start in starts
    )
    return sorted(descended, key=lambda fit: fit.loss)


def _resticking(
    evaluator: Evaluator, layout: CoordinateLayout, blocks: Bools, best: SearchResult
) -> Search[SearchResult]:
    """Try other speeds below which the stem sticks again, and descend from the best."""
    if layout.bounds.high[base_coordinate.RESTICK] <= 0.0:
        return best
    now = float(best.candidate[base_coordinate.RESTICK])
    trials = np.tile(best.candidate, (len(RESTICKS) + 2, 1))
    trials[:, base_coordinate.RESTICK] = [*RESTICKS, 0.75 * now, 1.3 * now]
    resticking = yield from _cheapest(evaluator, layout, blocks, layout.bounds.clip(trials), 1)
    if resticking[0].loss >= best.loss:
        return best
    best = yield from descend(evaluator, layout, blocks, resticking[0].candidate, AFTER_RESTICK)
    return best


def _around(
    evaluator: Evaluator,
    layout: CoordinateLayout,
    blocks: Bools,
    best: SearchResult,
    effort: FitEffort,
) -> Search[SearchResult]:
    """The best of populations about ``best``."""
    spread, rng = evaluator.spread(layout, effort.width), np.random.default_rng(SEED)
    around = CrossEntropy(best, spread, layout.bounds, rng)
    for _ in range(POPULATION_ROUNDS):
        request = RunRequest(layout, around.draw(effort.population))
        yield [request]
        around.learn(request.candidates, evaluator.mean_loss(request.losses, blocks))
    return around.best


def crossfit(
    evaluator: Evaluator,
    layout: CoordinateLayout,
    starts: Floats,
    effort: FitEffort,
) -> Search[Fitted]:
    """Fit ``layout``'s hypothesis to each fold; ``starts`` (m, size) must not depend on them."""
    begun = yield from ranked(evaluator, layout, starts, effort.keep)
    fitted = yield from from_best(evaluator, layout, begun, effort)
    return fitted


def from_best(
    evaluator: Evaluator,
    layout: CoordinateLayout,
    begun: BestOfFolds,
    effort: FitEffort,
    simple: tuple[float, float] = (np.inf, np.inf),
) -> Search[Fitted]:
    """``crossfit`` from the best starts of each fold, of which ``effort`` says how many.

    ``simple`` are the losses of a poorer hypothesis on both folds: what does not come near them
    is not searched further.
    """
    firsts = yield from run_together(
        _first_rounds(evaluator, layout, fold, best[: effort.keep], effort, least)
        for fold, best, least in zip(folds(evaluator), begun, simple, strict=True)
    )
    # One fold alone may be worse because its fit misses a few breakaways.
    go_on = any(
        first.reached[0].loss <= effort.no_better * least
        for first, least in zip(firsts, simple, strict=True)
    )
    both_folds = yield from run_together(
        _to_the_end(evaluator, layout, fold, first.reached, effort, first.left if go_on else 0)
        for fold, first in zip(folds(evaluator), firsts, strict=True)
    )
    fitted = yield from scored(layout, np.array([fit.candidate for fit in both_folds]))
    return fitted


def ranked(
    evaluator: Evaluator, layout: CoordinateLayout, starts: Floats, keep: int
) -> Search[BestOfFolds]:
    """The ``keep`` best of ``starts`` (m, size) for the even and for the odd blocks, best first."""
    request = RunRequest(layout, starts)
    yield [request]
    even, odd_blocks = (
        by_loss(starts, evaluator.mean_loss(request.losses, fold), keep)
        for fold in folds(evaluator)
    )
    return even, odd_blocks


def best_of_folds(
    evaluator: Evaluator, layout: CoordinateLayout, starts: Floats, keep: int
) -> Search[BestOfFolds]:
    """The ``keep`` best of ``starts`` (2, m, size), which were found on the even and on the odd
    blocks, each for its own fold."""
    even, odd_blocks = yield from run_together(
        _cheapest(evaluator, layout, fold, of_fold, keep)
        for fold, of_fold in zip(folds(evaluator), starts, strict=True)
    )
    return even, odd_blocks


def on_both(layout: CoordinateLayout, candidate: Floats) -> Fitted:
    """A candidate (size,) in the place of both folds' fits, without losses."""
    return Fitted(layout, np.vstack((candidate, candidate)), np.empty((2, 0)))


def own_losses(evaluator: Evaluator, fitted: Fitted) -> tuple[float, float]:
    """The mean loss of each fold by the fit to that fold."""
    even, odd_blocks = (
        float(evaluator.mean_loss(row[None], fold)[0])
        for row, fold in zip(fitted.losses, folds(evaluator), strict=True)
    )
    return even, odd_blocks


def refit(evaluator: Evaluator, fitted: Fitted, effort: FitEffort, *more: Floats) -> Search[Fitted]:
    """Search on from ``fitted`` on each fold, and from more candidates for each (2, m)."""
    starts = np.stack((fitted.candidates, *more), axis=1)
    both_folds = yield from run_together(
        search(evaluator, fitted.layout, fold, of_fold, effort)
        for fold, of_fold in zip(folds(evaluator), starts, strict=True)
    )
    went_on = yield from scored(fitted.layout, np.array([fit.candidate for fit in both_folds]))
    return better(evaluator, fitted, went_on)


def better(evaluator: Evaluator, old: Fitted, new: Fitted) -> Fitted:
    """The fit of each fold that is better on the fold it was fitted to; both of one layout."""
    candidates, losses = new.candidates.copy(), new.losses.copy()
    for i, fold in enumerate(folds(evaluator)):
        if evaluator.counts[fold].sum() and old.losses[i, fold].sum() < new.losses[i, fold].sum():
            candidates[i], losses[i] = old.candidates[i], old.losses[i]
    return Fitted(new.layout, candidates, losses)


def scored(layout: CoordinateLayout, candidates: Floats) -> Search[Fitted]:
    """Two fits (2, size), one to each fold, with their losses."""
    request = RunRequest(layout, candidates)
    yield [request]
    return Fitted(layout, candidates, request.losses)


def gain(evaluator: Evaluator, simple: Fitted, rich: Fitted) -> Advantage:
    """How much better ``rich`` predicts the blocks that neither was fitted to."""
    op_open = evaluator.problem.op_open
    return advantage(simple.heldout, rich.heldout, evaluator.counts, evaluator.delta, op_open)


@dataclass(frozen=True)
class Beginning:
    """S and J, percent, from which a search for one more term begins.

    ``plain``: with gain 1 and zero 0, because a base that lacks the term has a biased reading to
    make up for it; else with the reading of the simple hypothesis.
    """

    S: float
    J: float
    plain: bool = False
    S_less: float = 0.0  # times the term's first coordinate: the part of S that belongs to the term
    J_less: float = 0.0
    restick: float | None = None  # speed of sticking again, %/s; else that of the simple hypothesis


def widened(
    evaluator: Evaluator, rich: TermSet, simple: Fitted, term: Term, beginnings: Sequence[Beginning]
) -> Floats:
    """(m, size) starts of ``rich`` = simple + ``term``: the term's own grid over ``beginnings``."""
    layout, grid = evaluator.layout(rich), term.starts(evaluator.summary)
    centre = simple.candidates.mean(axis=0)
    slow, fast = np.sort(simple.candidates[:, base_coordinate.RESTICK])
    if fast - slow > DISAGREE:
        # The canonical value: no lag fits beside any other, and higher speeds are tried after the
        # descent.
        centre[base_coordinate.RESTICK] = slow
    rows = []
    for beginning in beginnings:
        start = _start_at(beginning, layout, simple.layout, centre)
        starts = np.tile(start, (grid.shape[0], 1))
        starts[:, layout.places[term.slug]] = grid
        if beginning.S_less != 0.0 or beginning.J_less != 0.0:
            S = np.maximum(beginning.S - beginning.S_less * grid[:, 0], 0.3 * beginning.S)
            J = np.clip(beginning.J - beginning.J_less * grid[:, 0], 0.05 * S, S)
            starts[:, base_coordinate.S_PERCENT] = S
            starts[:, base_coordinate.RATIO] = J / np.maximum(S, 1e-6)
        rows.append(starts)
    return layout.bounds.clip(np.vstack(rows))


def _start_at(
    beginning: Beginning, layout: CoordinateLayout, simple: CoordinateLayout, centre: Floats
) -> Floats:
    """(size,) a start in ``layout`` with the S and J of ``beginning`` and all else from ``centre``,
    a candidate of the ``simple`` layout.
    """
    start = np.zeros(layout.size)
    start[: base_coordinate.N_BASE] = centre[: base_coordinate.N_BASE]
    start[base_coordinate.S_PERCENT] = beginning.S
    start[base_coordinate.RATIO] = beginning.J / max(beginning.S, 1e-6)
    if beginning.restick is not None:
        start[base_coordinate.RESTICK] = beginning.restick
    if beginning.plain:
        start[[base_coordinate.ZERO, base_coordinate.GAIN]] = 0.0
    for slug, coordinate_slice in simple.places.items():
        start[layout.places[slug]] = centre[coordinate_slice]
    return start


def curvature(evaluator: Evaluator, fitted: Fitted) -> Advantage:
    """How much better unseen blocks are predicted by a reading that is bent over the stroke.

    A bowed linkage or an uneven scale looks like a straight line over a part of the stroke. The
    residual separates them from a zero or span error, which leaves nothing that follows the travel.
    A cubic of the travel is fitted to the residual of each fold's fit and added on the other fold.
    """
    block = evaluator.problem.block
    before, after = np.zeros(evaluator.problem.n_blocks), np.zeros(evaluator.problem.n_blocks)
    for candidate, fold, other in zip(
        fitted.candidates, folds(evaluator), reversed(folds(evaluator)), strict=True
    ):
        simulated, _ = evaluator.assimilated(fitted.layout, candidate)
        residual = evaluator.residual(simulated)
        seen, unseen = _blocks_inside(evaluator, fold), _blocks_inside(evaluator, other)
        curve = _curve(simulated[seen], residual[seen], simulated[unseen], evaluator.delta)
        for sums, unseen_residual in (
            (before, residual[unseen]),
            (after, residual[unseen] - curve),
        ):
            loss = evaluator.delta**2 * np.log1p((unseen_residual / evaluator.delta) ** 2)
            sums += np.bincount(block[unseen], loss, minlength=sums.size)
    return advantage(before, after, evaluator.measured_counts, evaluator.delta)


def _blocks_inside(evaluator: Evaluator, fold: Bools) -> Bools:
    """(n,) the measured samples of a fold."""
    return np.asarray(evaluator.measured & fold[np.maximum(evaluator.problem.block, 0)])


def _curve(places: Floats, residual: Floats, new_places: Floats, delta: float) -> Floats:
    """(m,) the robust cubic of ``residual`` over ``places``, read at ``new_places``."""
    if places.size < BEND_SAMPLES:
        return np.zeros(new_places.size)
    low, high = np.percentile(places, (2.0, 98.0))
    centre, half = 0.5 * (low + high), max(0.5 * (high - low), 1e-3)
    columns = np.polynomial.legendre.legvander(
        np.clip((places - centre) / half, -1, 1), BEND_DEGREE
    )
    coefficients = robust_coefficients(columns, residual, delta)
    basis_there = np.polynomial.legendre.legvander(
        np.clip((new_places - centre) / half, -1, 1), BEND_DEGREE
    )
    return np.asarray(basis_there @ coefficients)


def robust_coefficients(columns: Floats, values: Floats, delta: float) -> Floats:
    """(m,) coefficients of ``columns`` (n, m) for ``values`` (n,), by Cauchy's loss of scale
    ``delta``: iteratively reweighted least squares.
    """
    weight: Floats = np.ones(values.size)
    coefficients: Floats = np.zeros(columns.shape[1])
    for _ in range(REWEIGHTINGS):
        weighted = columns * weight[:, None]
        solved = np.linalg.lstsq(weighted.T @ columns, weighted.T @ values, rcond=None)
        coefficients = np.asarray(solved[0], dtype=np.float64)
        weight = np.asarray(1.0 / (1.0 + ((values - columns @ coefficients) / delta) ** 2))
    return coefficients
