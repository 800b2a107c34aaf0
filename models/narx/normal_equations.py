"""The normal matrix of every network in a batch, for Levenberg-Marquardt, on a CPU or a GPU.

On a CPU the compiled kernel takes one network after the other, with its runs side by side: this
needs no padding, and a worse trial is stopped early. On a GPU torch works on all networks at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import torch
from torch import Tensor

from stemwatch.models.narx import kernel, torch_batch
from stemwatch.models.narx.architecture import EDGE
from stemwatch.models.narx.levenberg_marquardt import Normal
from stemwatch.models.narx.run_plan import Indices, segments
from stemwatch.models.narx.torch_batch import (
    Clamps,
    SegmentBlock,
    Weights,
    clamps,
    recorded,
    segment_blocks,
)
from stemwatch.models.narx.training_record import TrainingRecord

_Runs = tuple[Indices, Indices]


def normal_matrices(
    valves: Sequence[TrainingRecord], hidden: int, horizon: int, members: int, device: str
) -> tuple[Normal, Tensor]:
    """For ``descend``: the normal matrices of the training segments of ``horizon`` samples as a
    function of weights (B, P), and the number of samples (B,) in them.

    Networks are ordered valve by valve, each valve's members together.
    """
    runs = [_longest_first(segments(valve.trained, horizon)) for valve in valves]
    counts = [float(lengths.sum()) for _, lengths in runs for _ in range(members)]
    samples = torch.tensor(counts, dtype=torch.float64, device=device)
    if by_kernel(samples.device):
        return partial(_one_by_one, valves, runs, hidden, members), samples
    blocks = segment_blocks(valves, horizon, hidden, members, device)
    return _AllAtOnce(blocks, clamps(valves, members, device), hidden), samples


def by_kernel(device: torch.device) -> bool:
    """Whether the compiled kernel works on that device; torch works on every other."""
    return device.type == "cpu"


def _longest_first(runs: _Runs) -> _Runs:
    """Sort runs by length, so that runs side by side in the kernel have about the same length."""
    starts, lengths = runs
    order = np.argsort(-lengths, kind="stable")
    return starts[order], lengths[order]


class _AllAtOnce:
    """Every network's matrix in one go; recorded at the first call, and played again after it."""

    def __init__(self, blocks: list[SegmentBlock], limits: Clamps, hidden: int) -> None:
        self._blocks, self._limits, self._hidden = blocks, limits, hidden
        self._recorded: Callable[[Tensor], Tensor] | None = None

    def __call__(self, flat: Tensor, _: Tensor) -> Tensor:
        if self._recorded is None:
            self._recorded = recorded(self._matrix, flat)
        return self._recorded(flat)

    def _matrix(self, flat: Tensor) -> Tensor:
        weights = Weights.split(flat, self._hidden)
        return torch_batch.normal_matrix(self._blocks, weights, self._limits)


def _one_by_one(
    valves: Sequence[TrainingRecord],
    runs: Sequence[_Runs],
    hidden: int,
    members: int,
    flat: Tensor,
    largest_squares: Tensor,
) -> Tensor:
    weights, largest = flat.numpy(), largest_squares.numpy()
    size = weights.shape[1] + 1
    matrices = np.zeros((weights.shape[0], size, size))
    for number, matrix in enumerate(matrices):
        valve = valves[number // members]
        signals = valve.signals
        finished = largest[number] > 0.0 and kernel.normal_matrix(
            weights[number],
            hidden,
            signals.level,
            signals.move,
            signals.position,
            runs[number // members],
            valve.limits,
            valve.ratio,
            EDGE,
            torch_batch.LIMIT,
            float(largest[number]),
            matrix,
        )
        if not finished:
            matrix[:], matrix[-1, -1] = 0.0, np.inf
    return torch.from_numpy(matrices)
