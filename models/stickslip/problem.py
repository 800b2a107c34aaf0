"""A recording made ready for fitting: filled, segmented, cut into blocks of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.forensics import noise_sigma, quantum
from stemwatch.models.recording import Bools, Floats, Recording
from stemwatch.models.stickslip import kernel

BLOCK_S = 90.0  # long against a slip, short against a record: neighbours are nearly independent
MIN_BLOCKS = 24
# After a restart the stem's history is unknown until it has slipped once; nothing is scored there.
WARM_UP_S = 30.0
LONGEST_BRIDGE_SAMPLES = 3  # a longer hole restarts the free run


@dataclass(frozen=True)
class Problem:
    """OP and MV of one valve with everything a free run needs to know.

    ``op`` and ``mv`` (n,) have short holes bridged by the last value; ``start`` (n,) marks
    restarts; ``block`` (n,) is the block of time of each sample or -1 where it is not scored.
    """

    op: Floats
    mv: Floats
    start: Bools
    block: NDArray[np.int64]
    n_blocks: int
    interval_s: float
    sigma: float  # measurement noise of MV, percent, at least its quantisation noise
    swing: float  # range of OP, 1st to 99th percentile, percent
    mv_is_percent: bool

    @property
    def scored(self) -> Bools:
        return np.asarray(self.block >= 0)

    def losses(self, candidates: Floats, delta: float) -> tuple[Floats, Floats]:
        """Robust losses (m, n_blocks) of parameter vectors (m, 10), and samples per block."""
        losses = np.empty((candidates.shape[0], self.n_blocks))
        counts = np.empty(self.n_blocks)
        kernel.block_losses(
            self.op,
            self.mv,
            self.start,
            self.block,
            self.interval_s,
            delta,
            candidates,
            losses,
            counts,
        )
        return losses, counts

    def simulate(self, q: Floats) -> Floats:
        """(n,) simulated MV, percent."""
        out = np.empty(self.op.size)
        kernel.simulate(self.op, self.mv, self.start, self.interval_s, q, out)
        return out

    def blocks_before(self, share: float) -> Bools:
        """(n_blocks,) True for the blocks within the first ``share`` of the record."""
        return np.arange(self.n_blocks) < round(share * self.n_blocks)


def _bridge(values: Floats, usable: Bools) -> Floats:
    """Hold the last usable value; before the first one, take the first."""
    if not usable.any():
        return np.zeros(values.size)
    index = np.where(usable, np.arange(values.size), -1)
    index = np.maximum.accumulate(index)
    index[index < 0] = int(np.argmax(usable))
    return np.ascontiguousarray(values[index])


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
    begun = np.maximum.accumulate(start)
    return np.asarray(usable & begun & (since >= warm_up))


def make_problem(recording: Recording) -> Problem:
    """The fitting problem of a recording that has OP and MV; raises ``ValueError`` without MV."""
    if recording.mv is None:
        raise ValueError(f"{recording.valve}: a stick-slip fit needs the valve position (MV)")
    usable = recording.usable
    n = len(recording)
    n_blocks = max(MIN_BLOCKS, round(recording.duration_s / BLOCK_S))
    n_blocks = max(1, min(n_blocks, n // 4))
    start = _restarts(usable)
    warm_up = min(round(WARM_UP_S / recording.interval_s), n // 10)
    scored = _scored(usable, start, max(warm_up, 1))
    block = np.where(scored, np.arange(n) * n_blocks // n, -1).astype(np.int64)
    op = _bridge(recording.op.values, usable)
    mv = _bridge(recording.mv.values, usable)
    low, high = np.percentile(op, (1.0, 99.0))
    steps = np.where(usable, recording.mv.values, np.nan)
    sigma = max(noise_sigma(steps), quantum(steps) / np.sqrt(12.0), 1e-3)
    return Problem(
        op=op,
        mv=mv,
        start=start,
        block=block,
        n_blocks=n_blocks,
        interval_s=recording.interval_s,
        sigma=sigma,
        swing=float(high - low),
        mv_is_percent=recording.mv.unit == recording.op.unit,
    )
