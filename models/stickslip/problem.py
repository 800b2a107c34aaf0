"""A recording made ready for fitting: filled, segmented, cut into blocks of time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats, Recording
from stemwatch.models.signals.forensics import noise_sigma, quantum
from stemwatch.models.signals.holes import held
from stemwatch.models.stickslip import kernel

# A block of time is long against a slip and short against a record, so that neighbours are nearly
# independent, and long enough in samples to hold a cycle.
BLOCK_S = 90.0
BLOCK_SAMPLES = 40
MIN_BLOCKS = 8
TRAIN_SHARE = 0.6  # of the record: the first part is fitted, the rest is held out
TRAIN_WAY = (0.3, 0.9)  # of OP's way must lie in the first part
TRAIN_LEAST = 0.2  # of the record on either side of the split
# After a restart the stem's history is unknown until it has slipped once; nothing is scored there.
WARM_UP_S = 30.0
LONGEST_BRIDGE_SAMPLES = 3  # a longer hole restarts the free run


@dataclass(frozen=True)
class FitProblem:
    """OP and MV of one valve with all that a free run needs.

    ``op`` and ``mv`` (n,) have short holes bridged by the last value; ``start`` (n,) marks restarts
    after gaps; ``block`` (n,) is the block of time of each sample or -1 where it is not scored. For
    fitting, a resting stem is set to its reading at the start of each block: no two breakaways are
    equal, and after one that a free run misses, minutes would hold no information about S and J.
    ``unsure_degree`` is the degree of the polynomial by which the curve from OP to ``op`` may be
    off; 0 where OP is percent for percent of travel. ``op_open`` is the standard deviation by which
    OP is uncertain because of its recorder, percent.
    """

    op: Floats
    mv: Floats
    start: kernel.Marks
    block: NDArray[np.int64]
    n_blocks: int
    interval_s: float
    sigma: float  # measurement noise of MV, percent, at least its quantisation noise
    swing: float  # range of OP, 1st to 99th percentile, percent
    mv_is_percent: bool
    unit_s: float = 1.0  # seconds in the unit of its times, see ``own_clock``
    unsure_degree: int = 0
    op_open: float = 0.0

    @property
    def scored(self) -> Bools:
        """(n,) True at samples that a loss counts."""
        return np.asarray(self.block >= 0)

    def losses(self, candidates: Floats, delta: float) -> tuple[Floats, Floats]:
        """Robust losses (m, n_blocks) of parameter vectors (m, 10), and samples per block."""
        losses = np.empty((candidates.shape[0], self.n_blocks))
        counts = np.empty(self.n_blocks)
        kernel.block_losses(
            self.op,
            self.mv,
            self.resynced_marks,
            self.block,
            self.interval_s,
            delta,
            candidates,
            losses,
            counts,
        )
        return losses, counts

    def only(self, blocks: Bools) -> FitProblem:
        """The same problem scored on some of its blocks; nothing is run beyond the last of them."""
        chosen = np.append(blocks, False)[self.block]  # block -1 is the False at the end
        return replace(self, block=np.where(chosen, self.block, -1))

    @cached_property
    def resynced_marks(self) -> kernel.Marks:
        """``start`` with a resynchronisation at the beginning of each block of time."""
        n = self.op.size
        marks = self.start.copy()
        begins = -(-np.arange(1, self.n_blocks) * n // self.n_blocks)  # rounded up, as ``block`` is
        begins = begins[begins < n]  # of fewer samples than blocks the last blocks are empty
        marks[begins[marks[begins] == 0]] = kernel.RESYNC
        return marks

    def simulate(self, q: Floats, *, resynced: bool = False) -> Floats:
        """(n,) MV by a free run, percent; only gaps restart it, or also each block of time."""
        out = np.empty(self.op.size)
        marks = self.resynced_marks if resynced else self.start
        kernel.simulate(self.op, self.mv, marks, self.interval_s, q, out)
        return out

    def training_blocks(self) -> Bools:
        """(n_blocks,) True for the first 60 % of the record, which is fitted; the rest is held out.

        Where less than 30 or more than 90 % of OP's path lies in that part, the split is where OP
        has made 60 % of its path: a stretch without movement is of no use on either side.
        """
        path = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(self.op)))))
        path_share = path[round(TRAIN_SHARE * (self.op.size - 1))] / max(path[-1], 1e-12)
        share = TRAIN_SHARE
        if not TRAIN_WAY[0] <= path_share <= TRAIN_WAY[1]:
            share = float(np.searchsorted(path, TRAIN_SHARE * path[-1])) / self.op.size
        least = round(TRAIN_LEAST * self.n_blocks)
        blocks = min(max(round(share * self.n_blocks), least), self.n_blocks - least)
        return np.arange(self.n_blocks) < blocks


def _restarts(usable: Bools) -> Bools:
    """True at the first usable sample and after each hole too long to bridge."""
    start = np.zeros(usable.size, dtype=bool)
    last = -(10**9)
    positions = np.flatnonzero(usable)
    previous = np.concatenate(([last], positions[:-1]))
    start[positions[positions - previous > LONGEST_BRIDGE_SAMPLES + 1]] = True
    return start


def _scored(usable: Bools, start: Bools, warm_up: int) -> Bools:
    """Usable samples at least ``warm_up`` samples after the last restart."""
    index = np.arange(usable.size)
    since = index - np.maximum.accumulate(np.where(start, index, -1))
    segment_start = np.maximum.accumulate(start)
    return np.asarray(usable & segment_start & (since >= warm_up))


def scored_samples(recording: Recording) -> Bools:
    """(n,) True at the samples a fit is scored on: usable, and past the warm-up after a hole."""
    usable = recording.usable
    warm_up = min(round(WARM_UP_S / recording.interval_s), len(recording) // 10)
    return _scored(usable, _restarts(usable), max(warm_up, 1))


def make_problem(recording: Recording) -> FitProblem:
    """The fitting problem of a recording that has OP and MV; raises ``ValueError`` without MV."""
    if recording.mv is None:
        raise ValueError(f"{recording.valve}: a stick-slip fit needs the valve position (MV)")
    usable = recording.usable
    n = len(recording)
    length = max(BLOCK_S / recording.interval_s, BLOCK_SAMPLES)
    n_blocks = max(MIN_BLOCKS, round(n / length))
    start = _restarts(usable)
    scored = scored_samples(recording)
    block = np.where(scored, np.arange(n) * n_blocks // n, -1).astype(np.int64)
    # A hole in MV alone does not invalidate the command.
    op = held(recording.op.values, recording.op.usable)
    mv = held(recording.mv.values, usable)
    low, high = np.percentile(op, (1.0, 99.0))
    steps = np.where(usable, recording.mv.values, np.nan)
    sigma = max(noise_sigma(steps), quantum(steps) / np.sqrt(12.0), 1e-3)
    return FitProblem(
        op=op,
        mv=mv,
        start=np.where(start, kernel.START, 0).astype(np.uint8),
        block=block,
        n_blocks=n_blocks,
        interval_s=recording.interval_s,
        sigma=sigma,
        swing=float(high - low),
        mv_is_percent=recording.mv.unit == recording.op.unit,
        unit_s=recording.unit_s,
    )
