"""Hypotheses on a workbench: a set of terms, its coordinates, and what a candidate costs.

Every hypothesis has the six coordinates of the base (S, J/S, the reading's zero and gain, a delay
within the sampling interval, the speed below which a moving stem sticks again) and those of its
terms. At a term's neutral values it is the base (a ringing positioner alone has no neutral value),
so that a richer hypothesis can only win by what it adds on blocks that it was not fitted to.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, pairwise

import numpy as np

from stemwatch.models.mismatch import stem as at
from stemwatch.models.mismatch.delay import delayed
from stemwatch.models.mismatch.given import Record, Scoring
from stemwatch.models.mismatch.kernel import LANES, follow
from stemwatch.models.mismatch.onsets import Onsets, Samples, onsets
from stemwatch.models.mismatch.stem import Stems
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
_NOTHING = np.empty((0, 0))


def batches(count: int) -> Iterator[slice]:
    """``count`` candidates in as few parts as run side by side, of nearly equal sizes."""
    parts = -(-count // LANES)
    ends = [count * part // parts for part in range(parts + 1)]
    return (slice(begin, end) for begin, end in pairwise(ends))


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

    @cached_property
    def shaping(self) -> tuple[tuple[Term, slice], ...]:
        """The terms that shape the command, and where their coordinates lie."""
        terms = self.hypothesis.terms
        return tuple((t, self.places[t.slug]) for t in terms if t.way is Way.COMMAND)

    @cached_property
    def filling(self) -> tuple[tuple[Term, slice], ...]:
        """The terms that fill the stem, and where their coordinates lie."""
        terms = self.hypothesis.terms
        return tuple((t, self.places[t.slug]) for t in terms if t.way is not Way.COMMAND)

    @cached_property
    def of_force(self) -> list[int]:
        """The coordinates that the force on the stem is made of."""
        shaping = (range(place.start, place.stop) for _, place in self.shaping)
        return [DELAY, *chain.from_iterable(shaping)]


@dataclass(frozen=True)
class _Forces:
    """Forces that were computed last: ``rows`` (LANES, n), and which one was made of what."""

    rows: Floats
    spare: Floats
    made: dict[tuple[object, ...], int] = field(default_factory=dict)


@dataclass(frozen=True)
class Runs:
    """Runs of m candidates: the readings and how far each breakaway came from ``fs``, (m, n)
    percent, and the loss in each block (m, n_blocks). Buffers: the next run writes over them."""

    simulated: Floats
    early_late: Floats
    losses: Floats


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
    _stems: Stems
    _forces: _Forces
    _runs: Runs
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
        runs = self._first(1)
        self._follow(layout, candidate[None], self.problem.start, 0.0, self.problem.block, runs)
        return np.array(runs.simulated[0])

    def assimilated(self, layout: Layout, candidate: Floats) -> tuple[Floats, Floats]:
        """(n,) MV with the breakaways where they were seen, and how far from ``fs`` each came."""
        runs = self.run(layout, candidate[None], self.problem.block)
        return np.array(runs.simulated[0]), np.array(runs.early_late[0])

    def run(self, layout: Layout, candidates: Floats, block: Samples) -> Runs:
        """Assimilated runs of up to LANES candidates (m, size), scored as ``block`` (n,) says."""
        runs = self._first(candidates.shape[0])
        self._follow(layout, candidates, self.marks, self.window, block, runs)
        return runs

    def block_losses(self, layout: Layout, candidates: Floats) -> Floats:
        """(m, n_blocks) sums of the robust loss of candidates (m, size)."""
        return self._losses(layout, candidates, self.problem.block)

    def _losses(self, layout: Layout, candidates: Floats, block: Samples) -> Floats:
        """``block_losses`` of the samples that ``block`` (n,) gives to a block."""
        losses = np.empty((candidates.shape[0], self.problem.n_blocks))
        for part in batches(candidates.shape[0]):
            only = Runs(_NOTHING, _NOTHING, losses[part])
            self._follow(layout, candidates[part], self.marks, self.window, block, only)
        return losses

    def loss(self, layout: Layout, blocks: Bools) -> Loss:
        """The mean robust loss over some blocks as a function of candidates."""
        block = self.within(blocks)

        def value(candidates: Floats) -> Floats:
            return self.mean_loss(self._losses(layout, candidates, block), blocks)

        return value

    def within(self, blocks: Bools) -> Samples:
        """(n,) the block of each sample, -1 outside of some ``blocks``."""
        block = self.problem.block
        return np.where(np.append(blocks, False)[block], block, -1)

    def mean_loss(self, losses: Floats, blocks: Bools) -> Floats:
        """(m,) the mean over the samples of some blocks of losses (m, n_blocks) within them."""
        return np.asarray(losses.sum(1) / max(float(self.counts[blocks].sum()), 1.0))

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

    def _first(self, count: int) -> Runs:
        """Buffers for the runs of some candidates."""
        runs = self._runs
        return Runs(runs.simulated[:count], runs.early_late[:count], runs.losses[:count])

    def _follow(
        self,
        layout: Layout,
        candidates: Floats,
        marks: Marks,
        window: float,
        block: Samples,
        runs: Runs,
    ) -> None:
        """Run up to LANES candidates (m, size) into ``runs``."""
        problem = self.problem
        rows = self._made(layout, candidates, marks)
        self._fill(layout, candidates)
        follow(
            self._forces.rows,
            rows,
            *self._stems.first(rows.size),
            Record(problem.mv, marks, *self._upcoming, problem.interval_s, window),
            Scoring(block, self.slack, self.delta, self.scatter, self.event),
            runs.losses,
            runs.simulated,
            runs.early_late,
        )

    def _fill(self, layout: Layout, candidates: Floats) -> None:
        """The stems of candidates (m, size)."""
        count = candidates.shape[0]
        each, q = self._stems.each[:count], self._stems.numbers[:count]
        for stem in each:
            stem.clear()
        q[:, at.S] = candidates[:, S_PERCENT]
        q[:, at.J] = candidates[:, S_PERCENT] * candidates[:, RATIO]
        q[:, at.ZERO], q[:, at.GAIN] = candidates[:, ZERO], 1.0 + candidates[:, GAIN]
        resticks = candidates[:, RESTICK]
        q[:, at.RESTICK] = np.where(resticks > 0.0, resticks, self.restick)
        for term, place in layout.filling:
            for stem, values in zip(each, candidates[:, place], strict=True):
                term.fill(stem, values)

    def _made(self, layout: Layout, candidates: Floats, marks: Marks) -> Samples:
        """(m,) rows of the forces on the stems; many candidates differ in nothing of it."""
        forces, how = self._forces, (marks is self.marks, *(t.slug for t, _ in layout.shaping))
        keys = [(*how, one.tobytes()) for one in candidates[:, layout.of_force]]
        wanted = set(keys)
        for key, candidate in zip(keys, candidates, strict=True):
            if key not in forces.made:
                row = len(forces.made)
                if row == LANES:
                    row = forces.made.pop(next(old for old in forces.made if old not in wanted))
                self._make(layout, candidate, marks, forces.rows[row])
                forces.made[key] = row
        return np.array([forces.made[key] for key in keys])

    def _make(self, layout: Layout, candidate: Floats, marks: Marks, row: Floats) -> None:
        """The force on the stem, percent, into ``row`` (n,)."""
        dt = self.problem.interval_s
        # The two take turns, so that the last is written to the row.
        p, spare = row, self._forces.spare
        if len(layout.shaping) % 2:
            p, spare = spare, p
        delayed(self.problem.op, marks, candidate[DELAY] / dt, p)
        for term, place in layout.shaping:
            term.shape(p, marks, dt, candidate[place], spare)
            p, spare = spare, p

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
        _stems=Stems.neutral(LANES, n, problem.interval_s),
        _forces=_Forces(np.empty((LANES, n)), np.empty(n)),
        _runs=Runs(
            np.empty((LANES, n)),
            np.empty((LANES, n)),
            np.empty((LANES, problem.n_blocks)),
        ),
    )
