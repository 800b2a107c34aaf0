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
from stemwatch.models.stickslip.kernel import RESYNC, Marks
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
EVENT_OF_DRAWN = 0.7  # samples that a breakaway counts for where most samples are drawn
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


@dataclass
class _Force:
    """The ``force`` (n,) that was computed last, what it was ``made`` of, and a spare buffer."""

    made: tuple[object, ...]
    force: Floats
    spare: Floats


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
    event: float  # samples that a breakaway counts for
    slack: Floats  # (n,) how far the true value may lie from a drawn one, percent; 0: measured
    _upcoming: tuple[Samples, Samples]
    _early_late: Floats
    _stem: Stem
    _last: _Force
    _out: Floats
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
        out, early_late = self.run(layout, candidate)
        return out.copy(), early_late.copy()

    def run(self, layout: Layout, candidate: Floats) -> tuple[Floats, Floats]:
        """As ``assimilated``, in buffers that the next run writes over."""
        out = self._out
        self._run(layout, candidate, self.marks, self.window, out)
        return out, self._early_late

    def block_losses(self, layout: Layout, candidates: Floats) -> Floats:
        """(m, n_blocks) sums of the robust loss of candidates (m, size)."""
        return self._losses(layout, candidates, self.problem.block)

    def _losses(self, layout: Layout, candidates: Floats, block: Samples) -> Floats:
        """``block_losses`` of the samples that ``block`` (n,) gives to a block."""
        losses = np.empty((candidates.shape[0], self.problem.n_blocks))
        for row, candidate in zip(losses, candidates, strict=True):
            out, early_late = self.run(layout, candidate)
            at.block_loss(
                out,
                self.problem.mv,
                self.slack,
                block,
                self.delta,
                early_late,
                self.scatter,
                self.event,
                row,
            )
        return losses

    def loss(self, layout: Layout, blocks: Bools) -> Loss:
        """The mean robust loss over some blocks as a function of candidates."""
        samples = max(float(self.counts[blocks].sum()), 1.0)
        block = np.where(np.append(blocks, False)[self.problem.block], self.problem.block, -1)

        def value(candidates: Floats) -> Floats:
            return np.asarray(self._losses(layout, candidates, block).sum(1) / samples)

        return value

    @cached_property
    def counts(self) -> Floats:
        """(n_blocks,) scored samples."""
        block = self.problem.block
        return np.bincount(block[block >= 0], minlength=self.problem.n_blocks).astype(np.float64)

    def residual(self, simulated: Floats) -> Floats:
        """(n,) how far a run lies from what was recorded, less what the archive leaves open."""
        off = self.problem.mv - simulated
        return np.asarray(off - np.clip(off, -self.slack, self.slack))

    @property
    def measured(self) -> Bools:
        """(n,) scored samples that were really measured."""
        return np.asarray(self.problem.scored & (self.slack == 0.0))

    @cached_property
    def told(self) -> Floats:
        """(n_blocks,) scored samples that were really measured."""
        block = self.problem.block[self.measured]
        return np.bincount(block, minlength=self.problem.n_blocks).astype(np.float64)

    def _run(
        self, layout: Layout, candidate: Floats, marks: Marks, window: float, out: Floats
    ) -> None:
        problem, stem = self.problem, self._stem
        p = self._force(layout, candidate, marks)
        stem.clear()
        q = stem.numbers
        q[at.S] = candidate[S_PERCENT]
        q[at.J] = candidate[S_PERCENT] * candidate[RATIO]
        q[at.ZERO], q[at.GAIN] = candidate[ZERO], 1.0 + candidate[GAIN]
        q[at.RESTICK] = candidate[RESTICK] if candidate[RESTICK] > 0.0 else self.restick
        for term in layout.hypothesis.terms:
            if term.way is not Way.COMMAND:
                term.fill(stem, candidate[layout.places[term.slug]])
        up, down = self._upcoming
        tables = stem.friction, stem.force, stem.breakaway, stem.wander
        late = self._early_late
        at.run(p, problem.mv, marks, problem.interval_s, q, *tables, up, down, window, late, out)

    def _force(self, layout: Layout, candidate: Floats, marks: Marks) -> Floats:
        """(n,) the force on the stem, percent; most runs differ from the last in nothing of it."""
        shaping = [term for term in layout.hypothesis.terms if term.way is Way.COMMAND]
        values = [candidate[layout.places[term.slug]] for term in shaping]
        made = (
            marks is self.marks,
            float(candidate[DELAY]),
            layout.hypothesis.slugs,
            *(one.tobytes() for one in values),
        )
        last = self._last
        if last.made == made:
            return last.force
        p, spare = last.force, last.spare
        problem = self.problem
        delayed(problem.op, marks, candidate[DELAY] / problem.interval_s, p)
        for term, one in zip(shaping, values, strict=True):
            term.shape(p, marks, problem.interval_s, one, spare)
            p, spare = spare, p
        last.made, last.force, last.spare = made, p, spare
        return p

    def spread(self, layout: Layout, scale: float) -> Floats:
        """(size,) widths of a search over all coordinates."""
        return np.asarray((layout.bounds.high - layout.bounds.low) * scale)


def _at_measured(marks: Marks, slack: Floats) -> Marks:
    """``marks`` with each resynchronisation at the first sample after a measured one.

    A value that the archive drew is no place to put a resting stem.
    """
    if not slack.any():
        return marks
    measured = np.flatnonzero(slack == 0.0)
    begins = np.flatnonzero(marks == RESYNC)
    place = np.searchsorted(measured, begins - 1)
    begins = measured[place[place < measured.size]] + 1
    moved = np.where(marks == RESYNC, 0, marks).astype(marks.dtype)
    begins = begins[begins < marks.size]
    moved[begins[moved[begins] == 0]] = RESYNC
    return moved


def make_bench(
    problem: Problem,
    look: Look,
    base_bounds: Bounds,
    delta: float,
    restick: float,
    scatter: float,
    slack: Floats | None = None,
) -> Bench:
    """The workbench of a recording; without ``slack`` all of it was measured."""
    n = problem.op.size
    slack = np.zeros(n) if slack is None else slack
    usable = np.isfinite(problem.mv)
    seen = onsets(problem.mv, usable, problem.sigma, problem.interval_s)
    return Bench(
        problem=problem,
        look=look,
        delta=delta,
        restick=restick,
        base_bounds=base_bounds,
        marks=_at_measured(problem.resynced_marks, slack),
        onsets=seen,
        scatter=scatter,
        window=WINDOW,
        event=EVENT_OF_DRAWN if slack.any() else at.EVENT,
        slack=slack,
        _upcoming=seen.upcoming(n),
        _early_late=np.zeros(n),
        _stem=Stem.neutral(n, problem.interval_s),
        _last=_Force((), np.empty(n), np.empty(n)),
        _out=np.empty(n),
    )
