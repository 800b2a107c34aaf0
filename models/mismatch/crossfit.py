"""Cross-fitting: each hypothesis is fitted twice, and judged on the blocks it was not fitted to.

Blocks of time alternate between two folds. A search sees one fold only; the score of a block comes
from the fit to the other one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.mismatch import bench as at
from stemwatch.models.mismatch.bench import Bench, Hypothesis, Layout
from stemwatch.models.mismatch.descent import descend
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip.fit import Advantage, advantage
from stemwatch.models.stickslip.search import Found, best_of, refine

SEED = 1977


@dataclass(frozen=True)
class Effort:
    """How long a search goes on: starts kept, rounds of descent, then a population about it."""

    keep: int
    rounds: int
    population: int = 0
    width: float = 0.01


LOOK = Effort(keep=2, rounds=5)
CAREFUL = Effort(keep=3, rounds=10, population=24)
POLISH = Effort(keep=1, rounds=8, population=24, width=0.006)
POPULATION_ROUNDS = 2
RESTICKS = (0.0, 0.01, 0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 4.0)  # percent per second
AFTER_RESTICK = 4  # rounds of descent


@dataclass(frozen=True)
class Fitted:
    """A hypothesis on both folds.

    ``candidates`` (2, size): fitted to the even and to the odd blocks; ``heldout`` (n_blocks,) the
    sum of the loss of each block by the fit that did not see it.
    """

    layout: Layout
    candidates: Floats
    heldout: Floats

    @property
    def slugs(self) -> tuple[str, ...]:
        return self.layout.hypothesis.slugs

    def values(self, slug: str) -> Floats:
        """(2, k) the coordinates of one term on both folds."""
        return np.asarray(self.candidates[:, self.layout.places[slug]])


def folds(bench: Bench) -> tuple[Bools, Bools]:
    """Even and odd blocks of time."""
    even = np.arange(bench.problem.n_blocks) % 2 == 0
    return even, ~even


def search(bench: Bench, layout: Layout, blocks: Bools, starts: Floats, effort: Effort) -> Found:
    """The best candidate on ``blocks`` that is found from ``starts`` (m, size). Seeded."""
    loss = bench.loss(layout, blocks)
    begun = best_of(loss, starts, keep=effort.keep)
    return _refined(bench, layout, blocks, begun, effort)


def _refined(
    bench: Bench, layout: Layout, blocks: Bools, begun: list[Found], effort: Effort
) -> Found:
    reached = [descend(bench, layout, blocks, one.candidate, effort.rounds) for one in begun]
    best = min(reached, key=lambda one: one.loss)
    best = _resticking(bench, layout, blocks, best)
    if not effort.population:
        return best
    around = refine(
        bench.loss(layout, blocks),
        best.candidate,
        bench.spread(layout, effort.width),
        layout.bounds,
        np.random.default_rng(SEED),
        rounds=POPULATION_ROUNDS,
        population=effort.population,
    )
    return min(best, around, key=lambda one: one.loss)


def _resticking(bench: Bench, layout: Layout, blocks: Bools, best: Found) -> Found:
    """Try other speeds below which the stem sticks again, and go on from a better one."""
    if layout.bounds.high[at.RESTICK] <= 0.0:
        return best
    now = float(best.candidate[at.RESTICK])
    trials = np.tile(best.candidate, (len(RESTICKS) + 2, 1))
    trials[:, at.RESTICK] = [*RESTICKS, 0.75 * now, 1.3 * now]
    found = best_of(bench.loss(layout, blocks), layout.bounds.clip(trials))[0]
    if found.loss >= best.loss:
        return best
    return descend(bench, layout, blocks, found.candidate, AFTER_RESTICK)


def crossfit(bench: Bench, layout: Layout, starts: Floats, effort: Effort) -> Fitted:
    """Fit ``layout``'s hypothesis to each fold; ``starts`` (m, size) must not depend on them."""
    losses = bench.block_losses(layout, starts)
    counts = bench.counts
    candidates = np.empty((2, layout.size))
    for i, fold in enumerate(folds(bench)):
        totals = losses[:, fold].sum(axis=1) / max(float(counts[fold].sum()), 1.0)
        order = np.argsort(totals, kind="stable")[: effort.keep]
        begun = [Found(starts[j].copy(), float(totals[j])) for j in order]
        candidates[i] = _refined(bench, layout, fold, begun, effort).candidate
    return scored(bench, layout, candidates)


def again(bench: Bench, fitted: Fitted, effort: Effort, *more: Floats) -> Fitted:
    """Go on from where ``fitted`` stands on each fold, and from more candidates for each (2, m)."""
    candidates = np.empty_like(fitted.candidates)
    for i, fold in enumerate(folds(bench)):
        starts = np.vstack((fitted.candidates[i : i + 1], *(extra[i : i + 1] for extra in more)))
        candidates[i] = search(bench, fitted.layout, fold, starts, effort).candidate
    return better(bench, fitted, scored(bench, fitted.layout, candidates))


def better(bench: Bench, old: Fitted, new: Fitted) -> Fitted:
    """The fit of each fold that is better on the fold it was fitted to."""
    counts = bench.counts
    candidates = new.candidates.copy()
    for i, fold in enumerate(folds(bench)):
        both = np.vstack((old.candidates[i], new.candidates[i]))
        losses = bench.block_losses(new.layout, both)[:, fold].sum(axis=1)
        if counts[fold].sum() and losses[0] < losses[1]:
            candidates[i] = old.candidates[i]
    return scored(bench, new.layout, candidates)


def scored(bench: Bench, layout: Layout, candidates: Floats) -> Fitted:
    """The held-out losses of two fits (2, size), one to each fold."""
    losses = bench.block_losses(layout, candidates)
    _, odd = folds(bench)
    heldout = np.where(odd, losses[0], losses[1])
    return Fitted(layout=layout, candidates=candidates, heldout=heldout)


def gain(bench: Bench, simple: Fitted, rich: Fitted) -> Advantage:
    """How much better ``rich`` predicts the blocks that neither was fitted to."""
    return advantage(simple.heldout, rich.heldout, bench.counts, bench.delta)


@dataclass(frozen=True)
class Beginning:
    """S and J, percent, from which a search for one more term begins.

    ``plain``: with gain 1 and zero 0, because a base that lacks the term has bent its reading to
    make up for it; else with the reading of the simple hypothesis.
    """

    S: float
    J: float
    plain: bool = False
    S_less: float = 0.0  # times the term's first coordinate: what of S was the term's
    J_less: float = 0.0


def widened(
    bench: Bench, rich: Hypothesis, simple: Fitted, term: Term, beginnings: Sequence[Beginning]
) -> Floats:
    """(m, size) starts of ``rich`` = simple + ``term``: the term's own grid over ``beginnings``."""
    layout, grid = bench.layout(rich), term.starts(bench.look)
    centre = simple.candidates.mean(axis=0)
    rows = []
    for one in beginnings:
        base = np.zeros(layout.size)
        base[: at.N_BASE] = centre[: at.N_BASE]
        base[at.S_PERCENT], base[at.RATIO] = one.S, one.J / max(one.S, 1e-6)
        if one.plain:
            base[[at.ZERO, at.GAIN]] = 0.0
        for slug, place in simple.layout.places.items():
            base[layout.places[slug]] = centre[place]
        block = np.tile(base, (grid.shape[0], 1))
        block[:, layout.places[term.slug]] = grid
        S = np.maximum(one.S - one.S_less * grid[:, 0], 0.3 * one.S)
        J = np.clip(one.J - one.J_less * grid[:, 0], 0.05 * S, S)
        if one.S_less != 0.0 or one.J_less != 0.0:
            block[:, at.S_PERCENT], block[:, at.RATIO] = S, J / np.maximum(S, 1e-6)
        rows.append(block)
    return layout.bounds.clip(np.vstack(rows))
