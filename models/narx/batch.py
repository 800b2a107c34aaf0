"""Records of different lengths and gaps as padded blocks of segments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from stemwatch.models.narx.run_plan import Indices, segments
from stemwatch.models.narx.sensitivities import Block, Bounds
from stemwatch.models.narx.training_record import TrainingRecord
from stemwatch.models.recording import Floats

# Samples in a block for each network. The size depends on the horizon alone, never on the batch:
# padding then adds exact zeros to sums of the same order, and a valve's result does not depend on
# the company it is trained in.
_BLOCK_SAMPLES = 1200
_MOST_ROWS = 256

_Columns = tuple[Floats, Floats, Floats, Floats, Floats, Floats]


def blocks(valves: Sequence[TrainingRecord], horizon: int, seeds: int, device: str) -> list[Block]:
    """Every valve's training segments of ``horizon`` samples.

    Networks are ordered valve by valve, each valve's seeds together.
    """
    rows = max(1, min(_MOST_ROWS, _BLOCK_SAMPLES // horizon))
    cuts = [segments(valve.trained, horizon) for valve in valves]
    most = max(starts.size for starts, _ in cuts)
    total = rows * max(1, -(-most // rows))
    columns = [
        _columns(valve, starts, lengths, horizon, total)
        for valve, (starts, lengths) in zip(valves, cuts, strict=True)
    ]
    stacked = [
        torch.from_numpy(np.stack(column)).to(device).repeat_interleave(seeds, dim=0)
        for column in zip(*columns, strict=True)
    ]
    return [
        _block([column[..., first : first + rows] for column in stacked])
        for first in range(0, total, rows)
    ]


def bounds(valves: Sequence[TrainingRecord], seeds: int, device: str) -> Bounds:
    """The clamps of each network."""
    table = torch.tensor([(*valve.limits, valve.ratio) for valve in valves], dtype=torch.float64)
    columns = table.repeat_interleave(seeds, dim=0).to(device)
    names = ("error_low", "error_high", "slowest", "fastest", "low", "high", "ratio")
    return Bounds(**{name: columns[:, [at]] for at, name in enumerate(names)})


def _columns(
    valve: TrainingRecord, starts: Indices, lengths: Indices, horizon: int, total: int
) -> _Columns:
    """Level, move, target, mask (T, R), before and last (R,), padded with zeros."""
    steps = np.arange(horizon)[:, None]
    mask = np.zeros((horizon, total))
    mask[:, : starts.size] = steps < lengths
    first = np.zeros(total, dtype=np.int64)
    first[: starts.size] = starts
    index = np.where(mask > 0, first + steps, 0)
    signals = valve.signals
    level, move, target = (
        np.where(mask > 0, signal[index], 0.0)
        for signal in (signals.level, signals.move, signals.position)
    )
    real = np.arange(total) < starts.size
    before, last = (np.where(real, signals.position[first - back], 0.0) for back in (2, 1))
    return level, move, target, mask, before, last


def _block(piece: Sequence[Tensor]) -> Block:
    names = ("level", "move", "target", "mask", "before", "last")
    whole = (tensor.contiguous() for tensor in piece)
    return Block(**dict(zip(names, whole, strict=True)))
