"""Hypotheses on a workbench: a set of terms, its coordinates, and what a candidate costs.

Every hypothesis has the six coordinates of the base (S, J/S, the reading's zero and gain, a delay
within the sampling interval, the speed below which a moving stem sticks again) and those of its
terms. At a term's neutral values it is the base (a ringing positioner alone has no neutral value),
so that a richer hypothesis can only win by what it adds on blocks that it was not fitted to.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numba import njit

from stemwatch.models.mismatch import stem as at
from stemwatch.models.mismatch.onsets import Onsets, Samples, onsets
from stemwatch.models.mismatch.stem import Stem
from stemwatch.models.mismatch.term import Look, Term, Way
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip.kernel import Marks
from stemwatch.models.stickslip.parameters import Bounds
from stemwatch.models.stickslip.problem import Problem
from stemwatch.models.stickslip.search import Loss

S_PERCENT, RATIO, ZERO, GAIN, DELAY, RESTICK = range(6)
N_BASE = 6
# A command is sampled somewhere between two scans; more than this is a dead time.
WITHIN_SAMPLE = 0.6
DEAD_TIME = "dead_time"
# How far from its level a breakaway may come, a share: three times a normal scatter and more.
WINDOW = 0.35
FIRST_SCATTER = 0.08  # of the level (S + J)/2


@njit(cache=True)
def delayed(command: Floats, marks: Marks, samples: float, out: Floats) -> None:
    """``command`` (n,) later by a delay in samples, linear between them; held at a START."""
    whole = int(samples)
    late = samples - whole
    first = 0
    for k in range(command.size):
        if marks[k] == 1:
            first = k
        i = max(k - whole, first)
        out[k] = command[i] + late * (command[max(i - 1, first)] - command[i])


@dataclass(frozen=True)
class Hypothesis:
    """The base and some terms, in the order of the chain."""

    terms: tuple[Term, ...] = ()

    @property
    def slugs(self) -> tuple[str, ...]:
        return tuple(term.slug for term in self.terms)

    def plus(self, term: Term) -> Hypothesis:
        """This hypothesis with one more term."""
        return Hypothesis(tuple(sorted((*self.terms, term), key=lambda t: (t.way, t.order))))

    def without(self, slug: str) -> Hypothesis:
        """This hypothesis without a term."""
        return Hypothesis(tuple(term for term in self.terms if term.slug != slug))


@dataclass(frozen=True)
class Layout:
    """Where the coordinates of a hypothesis lie, and their limits."""

    hypothesis: Hypothesis
    places: dict[str, slice]
    bounds: Bounds

    @property
    def size(self) -> int:
        return int(self.bounds.low.size)


@dataclass(frozen=True)
class Bench:
    """One recording with everything that a search over hypotheses shares."""

    problem: Problem
    look: Look
    delta: float  # scale of the robust loss, percent
    restick: float  # %/s, when a moving stem sticks again; see ``stickslip.fit``
    base_bounds: Bounds
    marks: Marks
    onsets: Onsets
    scatter: float  # of the breakaway level, percent of span
    window: float  # how far from its level a breakaway may come, a share; 0: free runs
    _upcoming: tuple[Samples, Samples]
    _early_late: Floats
    _stem: Stem
    _buffers: tuple[Floats, Floats, Floats]
    _layouts: dict[tuple[str, ...], Layout] = field(default_factory=dict)

    def layout(self, hypothesis: Hypothesis) -> Layout:
        """The coordinates of ``hypothesis``."""
        key = hypothesis.slugs
        if key not in self._layouts:
            self._layouts[key] = self._make_layout(hypothesis)
        return self._layouts[key]

    def _make_layout(self, hypothesis: Hypothesis) -> Layout:
        low, high = [*self.base_bounds.low], [*self.base_bounds.high]
        places = {}
        for term in hypothesis.terms:
            begin = len(low)
            for coordinate in term.coordinates(self.look):
                low.append(coordinate.low)
                high.append(coordinate.high)
            places[term.slug] = slice(begin, len(low))
        if DEAD_TIME in places:
            high[DELAY] = 0.0  # one delay is enough
        return Layout(hypothesis, places, Bounds(np.array(low), np.array(high)))

    def simulate(self, layout: Layout, candidate: Floats) -> Floats:
        """(n,) MV by a free run, percent; only gaps in the recording restart it."""
        out = np.empty(self.problem.op.size)
        self._run(layout, candidate, self.problem.start, 0.0, out)
        return out

    def assimilated(self, layout: Layout, candidate: Floats) -> tuple[Floats, Floats]:
        """(n,) MV with the breakaways where they were seen, and how far from ``fs`` each came."""
        out = np.empty(self.problem.op.size)
        self._run(layout, candidate, self.marks, self.window, out)
        return out, self._early_late.copy()

    def block_losses(self, layout: Layout, candidates: Floats) -> Floats:
        """(m, n_blocks) sums of the robust loss of candidates (m, size)."""
        losses = np.empty((candidates.shape[0], self.problem.n_blocks))
        out = self._buffers[2]
        for row, candidate in zip(losses, candidates, strict=True):
            self._run(layout, candidate, self.marks, self.window, out)
            at.block_loss(
                out,
                self.problem.mv,
                self.problem.block,
                self.delta,
                self._early_late,
                self.scatter,
                row,
            )
        return losses

    def loss(self, layout: Layout, blocks: Bools) -> Loss:
        """The mean robust loss over some blocks as a function of candidates."""
        samples = max(float(self.counts[blocks].sum()), 1.0)

        def value(candidates: Floats) -> Floats:
            return np.asarray(self.block_losses(layout, candidates)[:, blocks].sum(1) / samples)

        return value

    @cached_property
    def counts(self) -> Floats:
        """(n_blocks,) scored samples."""
        block = self.problem.block
        return np.bincount(block[block >= 0], minlength=self.problem.n_blocks).astype(np.float64)

    def _run(
        self, layout: Layout, candidate: Floats, marks: Marks, window: float, out: Floats
    ) -> None:
        p, spare, _ = self._buffers
        problem, stem = self.problem, self._stem
        delayed(problem.op, marks, candidate[DELAY] / problem.interval_s, p)
        stem.clear()
        q = stem.numbers
        q[at.S] = candidate[S_PERCENT]
        q[at.J] = candidate[S_PERCENT] * candidate[RATIO]
        q[at.ZERO], q[at.GAIN] = candidate[ZERO], 1.0 + candidate[GAIN]
        q[at.RESTICK] = candidate[RESTICK] if candidate[RESTICK] > 0.0 else self.restick
        for term in layout.hypothesis.terms:
            values = candidate[layout.places[term.slug]]
            if term.way is Way.COMMAND:
                term.shape(p, marks, problem.interval_s, values, spare)
                p, spare = spare, p
            else:
                term.fill(stem, values)
        up, down = self._upcoming
        tables = stem.friction, stem.force, stem.breakaway, stem.wander
        late = self._early_late
        at.run(p, problem.mv, marks, problem.interval_s, q, *tables, up, down, window, late, out)

    def spread(self, layout: Layout, scale: float) -> Floats:
        """(size,) widths of a search over all coordinates."""
        return np.asarray((layout.bounds.high - layout.bounds.low) * scale)


def make_bench(
    problem: Problem,
    look: Look,
    base_bounds: Bounds,
    delta: float,
    restick: float,
    scatter: float,
) -> Bench:
    """The workbench of a recording."""
    n = problem.op.size
    usable = np.isfinite(problem.mv)
    seen = onsets(problem.mv, usable, problem.sigma, problem.interval_s)
    return Bench(
        problem=problem,
        look=look,
        delta=delta,
        restick=restick,
        base_bounds=base_bounds,
        marks=problem.resynced_marks(),
        onsets=seen,
        scatter=scatter,
        window=WINDOW,
        _upcoming=seen.upcoming(n),
        _early_late=np.zeros(n),
        _stem=Stem.neutral(n, problem.interval_s),
        _buffers=(np.empty(n), np.empty(n), np.empty(n)),
    )
