"""Hypotheses and what they cost: a set of terms, its coordinates, the loss of each candidate.

Every hypothesis has the six coordinates of the base (S, J/S, the reading's zero and gain, a delay
within the sampling interval, the speed below which a moving stem sticks again) and those of its
terms. At a term's neutral values it is the base (a ringing positioner alone has no neutral value),
so that a richer hypothesis can only win by what it adds on blocks that it was not fitted to.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate, chain, pairwise
from typing import NamedTuple

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.mismatch.fit.base_coordinate import (
    DELAY,
    GAIN,
    N_BASE,
    RATIO,
    RESTICK,
    S_PERCENT,
    ZERO,
)
from stemwatch.models.mismatch.fit.forces import Forces, Shaping
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.kernel import Record, Scoring, follow, used
from stemwatch.models.mismatch.stem_model.lane_rows import LANES
from stemwatch.models.mismatch.stem_model.lanes import WIDTH, alike
from stemwatch.models.mismatch.stem_model.stem import Stem, Stems, Tables
from stemwatch.models.mismatch.term import ActsOn, RecordingSummary, Term
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip.kernel import RESYNC, Marks
from stemwatch.models.stickslip.onsets import Onsets, Samples, onsets
from stemwatch.models.stickslip.parameters import Bounds
from stemwatch.models.stickslip.problem import FitProblem
from stemwatch.models.stickslip.search import Loss

DEAD_TIME = "dead_time"
DRIVE, LOAD = "motor_drive", "load_by_position"  # these limit the base's own coordinates
LATE_DRIVE = 8.0  # samples by which a bus and a controller may delay a command
# How far from its level a breakaway may come, a share: three times a normal scatter and more.
WINDOW = 0.35
EVENT_OF_DRAWN = 0.7  # weight of a breakaway, in samples, where most of these are interpolated
_NOTHING = np.empty((0, 0))


def batches(counts: Sequence[int]) -> Iterator[list[tuple[int, slice]]]:
    """Distribute requests of ``counts`` candidates each over as few batches as possible, of nearly
    equal numbers of whole vectors. Yields for each batch the numbers of its requests and the slice
    of candidates taken from each.
    """
    total, ends = sum(counts), list(accumulate(counts, initial=0))
    parts, vectors = -(-total // LANES), -(-total // WIDTH)
    cuts = [min(vectors * part // parts * WIDTH, total) for part in range(parts + 1)]
    for begin, end in pairwise(cuts):
        yield [
            (batch_number, slice(max(begin - first, 0), min(end, last) - first))
            for batch_number, (first, last) in enumerate(pairwise(ends))
            if first < end and begin < last
        ]


@compiled()
def _means(losses: Floats, blocks: Bools, counts: Floats) -> Floats:
    """(m,) the mean loss a sample over some blocks, from the sums ``losses`` (m, n_blocks)."""
    samples, means = 0.0, np.zeros(losses.shape[0])
    for block in range(counts.size):
        if blocks[block]:
            samples += counts[block]
            for row in range(means.size):
                means[row] += losses[row, block]
    return means / max(samples, 1.0)


@compiled()
def _fill_base(base: Floats, restick: float, numbers: Floats) -> None:
    """The base's coordinates (m, 6) into the numbers (m, 22) of the stems; ``restick`` is the speed
    of sticking again of those that have none of their own.
    """
    for row in range(base.shape[0]):
        own, q = base[row], numbers[row]
        q[stem_number.S], q[stem_number.J] = own[S_PERCENT], own[S_PERCENT] * own[RATIO]
        q[stem_number.ZERO], q[stem_number.GAIN] = own[ZERO], 1.0 + own[GAIN]
        q[stem_number.RESTICK] = own[RESTICK] if own[RESTICK] > 0.0 else restick


@dataclass(frozen=True)
class TermSet:
    """The base and some terms, in the order of the chain."""

    terms: tuple[Term, ...] = ()

    @cached_property
    def slugs(self) -> tuple[str, ...]:
        """The slugs of the terms, in the order of the chain."""
        return tuple(term.slug for term in self.terms)

    def plus(self, term: Term) -> TermSet:
        """This hypothesis with one more term."""
        return TermSet(tuple(sorted((*self.terms, term), key=lambda t: (t.acts_on, t.order))))

    def without(self, slug: str) -> TermSet:
        """This hypothesis without a term."""
        return TermSet(tuple(term for term in self.terms if term.slug != slug))


@dataclass(frozen=True)
class CoordinateLayout:
    """Where the coordinates of a hypothesis lie, and their limits.

    ``places`` has those of each term, by its slug; the six of the base come before them.
    """

    hypothesis: TermSet
    places: dict[str, slice]
    bounds: Bounds

    @property
    def size(self) -> int:
        """How many coordinates a candidate has: six of the base, and those of the terms."""
        return int(self.bounds.low.size)

    @cached_property
    def shaping(self) -> Shaping:
        """The terms that shape the command, by the coordinates ``of_force``."""
        terms = [term for term in self.hypothesis.terms if term.acts_on is ActsOn.COMMAND]
        parts, begin = [], 1
        for term in terms:
            coordinate_slice = self.places[term.slug]
            end = begin + coordinate_slice.stop - coordinate_slice.start
            parts.append((term, slice(begin, end)))
            begin = end
        return Shaping(tuple(parts), tuple(term.slug for term in terms))

    @cached_property
    def of_force(self) -> Samples:
        """The coordinates that the force on the stem is made of."""
        places = (self.places[slug] for slug in self.shaping.slugs)
        return np.array(
            [
                DELAY,
                *chain.from_iterable(
                    range(coordinate_slice.start, coordinate_slice.stop)
                    for coordinate_slice in places
                ),
            ]
        )

    @cached_property
    def filling(self) -> tuple[tuple[Term, slice], ...]:
        """The terms that fill the stem, and where their coordinates lie."""
        terms = self.hypothesis.terms
        return tuple((t, self.places[t.slug]) for t in terms if t.acts_on is not ActsOn.COMMAND)

    @cached_property
    def kind(self) -> tuple[bool, bool, bool, bool]:
        """Whether levels vary along the record, whether readings wander, whether the stem has
        inertia, and whether they are ``alike``: candidates of one kind can run in one batch.
        """
        stem = Stem.neutral(2, 1.0)
        for term, coordinate_slice in self.filling:
            term.fill(stem, self.bounds.high[coordinate_slice])
        varied, timed, heavy = used(stem.numbers[None])
        return bool(varied), bool(timed), bool(heavy), bool(alike(stem.numbers[None]))


class RunResults(NamedTuple):
    """Runs of candidates side by side: see ``kernel.follow``. Buffers: the next runs write over
    them.

    ``simulated`` (n, candidates) sample by sample; of m candidates, the first of which is in column
    ``first``, ``early_late`` (m, n) and ``losses`` (m, n_blocks).
    """

    simulated: Floats
    early_late: Floats
    losses: Floats
    first: int = 0


class RunRequest:
    """A request of a search: assimilated runs of ``candidates`` (m, size) of a layout.

    The answer is ``losses`` (m, n_blocks), the sums of the robust loss over every block of time. A
    request that ``reads`` is given the runs sample by sample as well.
    """

    reads = False

    def __init__(self, layout: CoordinateLayout, candidates: Floats) -> None:
        self.layout, self.candidates = layout, candidates
        self.losses = _NOTHING

    def take(self, part: slice, runs: RunResults) -> None:
        """Receive the runs of some of the candidates; the next batch overwrites them."""
        self.losses[part] = runs.losses


def _reads(requests: list[RunRequest]) -> bool:
    """Whether one of the requests is given the runs sample by sample."""
    return any(request.reads for request in requests)


# Candidates (m, size) of a layout that run side by side with those of others.
Piece = tuple[CoordinateLayout, Floats]


@dataclass(frozen=True)
class Evaluator:
    """One recording with everything that a search over hypotheses shares.

    ``slack`` (n,) is how far the true value may lie from an interpolated one, percent; 0 where it
    was measured.
    """

    problem: FitProblem
    summary: RecordingSummary
    delta: float  # scale of the robust loss, percent
    restick: float  # %/s, when a moving stem sticks again; see ``stickslip.evaluator``
    base_bounds: Bounds
    marks: Marks
    onsets: Onsets
    scatter: float  # of the breakaway level, percent of span
    window: float  # how far from its level a breakaway may come, a share; 0: free runs
    event: float  # weight of a breakaway, in samples
    slack: Floats
    _upcoming: tuple[Samples, Samples]
    _stems: Stems
    _forces: Forces
    _runs: RunResults
    _layouts: dict[tuple[str, ...], CoordinateLayout] = field(default_factory=dict)

    def layout(self, hypothesis: TermSet) -> CoordinateLayout:
        """The coordinates of ``hypothesis``."""
        key = hypothesis.slugs
        if key not in self._layouts:
            self._layouts[key] = self._make_layout(hypothesis)
        return self._layouts[key]

    def _make_layout(self, hypothesis: TermSet) -> CoordinateLayout:
        low, high = [*self.base_bounds.low], [*self.base_bounds.high]
        places = {}
        for term in hypothesis.terms:
            begin = len(low)
            for coordinate in term.coordinates(self.summary):
                low.append(coordinate.low)
                high.append(coordinate.high)
            places[term.slug] = slice(begin, len(low))
        if DEAD_TIME in places:
            high[DELAY] = 0.0  # a dead time takes the place of this delay
        elif DRIVE in places:
            high[DELAY] = LATE_DRIVE * self.problem.interval_s
        if LOAD in places:
            low[GAIN] = high[GAIN] = 0.0  # a load that rises with position is a span error
        return CoordinateLayout(hypothesis, places, Bounds(np.array(low), np.array(high)))

    def simulate(self, layout: CoordinateLayout, candidate: Floats) -> Floats:
        """(n,) MV by a free run, percent; only gaps in the recording restart it."""
        runs = self._buffers(1)
        self._follow([(layout, candidate[None])], self.problem.start, 0.0, runs)
        return np.array(runs.simulated[:, 0])

    def simulate_each(self, candidates: Sequence[tuple[CoordinateLayout, Floats]]) -> Floats:
        """(m, n) what ``simulate`` gives of each, run side by side."""
        traces = np.empty((len(candidates), self.problem.op.size))
        for first in range(0, len(candidates), LANES):
            pieces = [(layout, one[None]) for layout, one in candidates[first : first + LANES]]
            runs = self._buffers(len(pieces))
            self._follow(pieces, self.problem.start, 0.0, runs)
            traces[first : first + len(pieces)] = runs.simulated.T
        return traces

    def assimilated(self, layout: CoordinateLayout, candidate: Floats) -> tuple[Floats, Floats]:
        """(n,) MV with the breakaways where they were seen, and how far from ``fs`` each of these
        ``onsets`` (e,) came, percent; 0 where the run did not let go with it."""
        runs = self._buffers(1)
        self._follow([(layout, candidate[None])], self.marks, self.window, runs)
        return np.array(runs.simulated[:, 0]), runs.early_late[0, self.onsets.at]

    def block_losses(self, layout: CoordinateLayout, candidates: Floats) -> Floats:
        """(m, n_blocks) sums of the robust loss of candidates (m, size)."""
        request = RunRequest(layout, candidates)
        self.answer([request])
        return request.losses

    def answer(self, requests: Iterable[RunRequest]) -> None:
        """Run the requests, candidates of one kind side by side, whichever search made them."""
        alike_requests: dict[tuple[tuple[str, ...], bytes], list[RunRequest]] = {}
        for request in requests:
            request.losses = np.empty((request.candidates.shape[0], self.problem.n_blocks))
            key = request.layout.hypothesis.slugs, request.candidates.tobytes()
            alike_requests.setdefault(key, []).append(request)
        of_kind = defaultdict(list)
        for same in alike_requests.values():
            of_kind[same[0].layout.kind].append(same)
        for group in of_kind.values():
            # Requests that need the runs themselves come first, so that few batches are kept sample
            # by sample.
            group.sort(key=lambda same: not _reads(same))
            for batch in batches([same[0].candidates.shape[0] for same in group]):
                self._serve([(group[i], part) for i, part in batch])

    def _serve(self, parts: list[tuple[list[RunRequest], slice]]) -> None:
        """Run up to LANES candidates, and hand each request its part of the results; those of one
        list want the same runs, as both folds do that begin at one start.
        """
        ends = list(accumulate(part.stop - part.start for _, part in parts))
        runs = self._buffers(ends[-1])
        if not any(_reads(same) for same, _ in parts):
            runs = RunResults(_NOTHING, _NOTHING, runs.losses)
        pieces = [(same[0].layout, same[0].candidates[part]) for same, part in parts]
        self._follow(pieces, self.marks, self.window, runs)
        for (same, part), (begin, end) in zip(parts, pairwise([0, *ends]), strict=True):
            early_late, losses = runs.early_late[begin:end], runs.losses[begin:end]
            for request in same:
                request.take(part, RunResults(runs.simulated, early_late, losses, begin))

    def loss(self, layout: CoordinateLayout, blocks: Bools) -> Loss:
        """The mean robust loss over some blocks as a function of candidates."""
        return lambda candidates: self.mean_loss(self.block_losses(layout, candidates), blocks)

    def within(self, blocks: Bools) -> Samples:
        """(n,) the block of each sample, -1 outside of some ``blocks``."""
        block = self.problem.block
        return np.where(np.append(blocks, False)[block], block, -1)

    def scored_within(self, blocks: Bools) -> tuple[Samples, Samples]:
        """The scored samples (m,) of some ``blocks``, and the breakaways (e,) on them."""
        key = blocks.tobytes()
        if key not in self._scored_within:
            block, at = self.within(blocks), self.onsets.at
            self._scored_within[key] = np.flatnonzero(block >= 0), at[block[at] >= 0]
        return self._scored_within[key]

    @cached_property
    def _scored_within(self) -> dict[bytes, tuple[Samples, Samples]]:
        return {}

    def mean_loss(self, losses: Floats, blocks: Bools) -> Floats:
        """(m,) the mean over the samples of some blocks of losses (m, n_blocks)."""
        return _means(losses, blocks, self.counts)

    @cached_property
    def counts(self) -> Floats:
        """(n_blocks,) scored samples."""
        block = self.problem.block
        return np.bincount(block[block >= 0], minlength=self.problem.n_blocks).astype(np.float64)

    def residual(self, simulated: Floats) -> Floats:
        """(n,) the residual of a run, reduced by the uncertainty ``slack`` of each recorded value,
        percent.
        """
        difference = self.problem.mv - simulated
        return np.asarray(difference - np.clip(difference, -self.slack, self.slack))

    @property
    def measured(self) -> Bools:
        """(n,) scored samples that were really measured."""
        return np.asarray(self.problem.scored & (self.slack == 0.0))

    @cached_property
    def measured_counts(self) -> Floats:
        """(n_blocks,) scored samples that were really measured."""
        block = self.problem.block[self.measured]
        return np.bincount(block, minlength=self.problem.n_blocks).astype(np.float64)

    def _buffers(self, count: int) -> RunResults:
        """The buffers for the runs of ``count`` candidates."""
        runs, n = self._runs, self.problem.op.size
        simulated = runs.simulated.ravel()[: n * count].reshape(n, count)
        return RunResults(simulated, runs.early_late[:count], runs.losses[:count])

    def _follow(
        self, pieces: Sequence[Piece], marks: Marks, window: float, runs: RunResults
    ) -> None:
        """Run up to LANES candidates in all into ``runs``."""
        problem = self.problem
        rows = self._forces.of(
            (layout.shaping, candidates[:, layout.of_force]) for layout, candidates in pieces
        )
        self._fill(pieces)
        follow(
            self._forces.rows,
            rows,
            *self._stems.first(rows.size),
            Record(problem.mv, marks, *self._upcoming, problem.interval_s, window),
            Scoring(problem.block, self.slack, self.delta, self.scatter, self.event),
            runs.losses,
            runs.simulated,
            runs.early_late,
        )

    def laid_out(
        self, layout: CoordinateLayout, candidates: Floats
    ) -> tuple[Floats, Samples, Floats, Tables]:
        """Of up to LANES candidates (m, size): all forces that are kept (r, n), the row of each
        candidate's (m,), numbers (m, 22) and tables. Buffers: what runs next writes over them.
        """
        rows = self._forces.of([(layout.shaping, candidates[:, layout.of_force])])
        self._fill([(layout, candidates)])
        return self._forces.rows, rows, *self._stems.first(rows.size)

    @cached_property
    def likelihoods(self) -> dict[tuple[tuple[str, ...], int, bytes], Floats]:
        """The logarithms of the likelihood that are known, by terms, courses and point: searches
        that begin alike come to the same points again."""
        return {}

    def _fill(self, pieces: Sequence[Piece]) -> None:
        """Write the stems of the candidates, in their order, into ``_stems``."""
        base = pieces[0][1][:, :N_BASE]
        if len(pieces) > 1:
            base = np.concatenate([candidates[:, :N_BASE] for _, candidates in pieces])
        count = base.shape[0]
        stem_of_each, q = self._stems.each[:count], self._stems.numbers[:count]
        self._stems.clear(count)
        _fill_base(base, self.restick, q)
        begin = 0
        for layout, candidates in pieces:
            end = begin + candidates.shape[0]
            for term, coordinate_slice in layout.filling:
                for stem, values in zip(
                    stem_of_each[begin:end], candidates[:, coordinate_slice], strict=True
                ):
                    term.fill(stem, values)
            begin = end

    def spread(self, layout: CoordinateLayout, scale: float) -> Floats:
        """(size,) widths of a search over all coordinates."""
        return np.asarray((layout.bounds.high - layout.bounds.low) * scale)


def _at_measured(marks: Marks, slack: Floats) -> Marks:
    """``marks`` with each resynchronisation at the first sample after a measured one.

    An interpolated value is not where the stem rested.
    """
    if not slack.any():
        return marks
    measured = np.flatnonzero(slack == 0.0)
    begins = np.flatnonzero(marks == RESYNC)
    measured_index = np.searchsorted(measured, begins - 1)
    begins = measured[measured_index[measured_index < measured.size]] + 1
    moved = np.where(marks == RESYNC, 0, marks).astype(marks.dtype)
    begins = begins[begins < marks.size]
    moved[begins[moved[begins] == 0]] = RESYNC
    return moved


def make_evaluator(
    problem: FitProblem,
    summary: RecordingSummary,
    base_bounds: Bounds,
    delta: float,
    restick: float,
    scatter: float,
    slack: Floats | None = None,
) -> Evaluator:
    """The evaluator of a recording; without ``slack`` all of it was measured."""
    n = problem.op.size
    slack = np.zeros(n) if slack is None else slack
    usable = np.isfinite(problem.mv)
    seen_onsets = onsets(problem.mv, usable, problem.sigma, problem.interval_s)
    return Evaluator(
        problem=problem,
        summary=summary,
        delta=delta,
        restick=restick,
        base_bounds=base_bounds,
        marks=_at_measured(problem.resynced_marks, slack),
        onsets=seen_onsets,
        scatter=scatter,
        window=WINDOW,
        event=EVENT_OF_DRAWN if slack.any() else stem_number.EVENT,
        slack=slack,
        _upcoming=seen_onsets.upcoming(n),
        _stems=Stems.neutral(LANES, n, problem.interval_s),
        _forces=Forces.none_yet(problem.op, problem.start, problem.interval_s, LANES),
        _runs=RunResults(
            np.empty((n, LANES)),
            np.empty((LANES, n)),
            np.empty((LANES, problem.n_blocks)),
        ),
    )
