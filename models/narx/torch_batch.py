"""Free runs of many networks at once, with forward sensitivities, in torch: training on a GPU.

The sensitivities are carried forward with the run, as Williams and Zipser (1989,
doi:10.1162/neco.1989.1.2.270) do for recurrent networks. Records of different lengths and gaps
become blocks of segments, padded to one size.

Axes: ``B`` networks (valves times seeds), ``T`` samples of a segment, ``R`` segments, ``P``
weights in the kernel's order (value, gate, hidden). All in scaled units, as in ``kernel``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from stemwatch.models.narx.architecture import EDGE, INPUTS
from stemwatch.models.narx.run_plan import Indices, segments
from stemwatch.models.narx.training_record import TrainingRecord
from stemwatch.models.recording import Floats

# Far beyond any useful gradient: a diverging run must not fill the matrix with inf.
LIMIT = 1e4


@dataclass(frozen=True, kw_only=True)
class SegmentBlock:
    """As many segments as are worked on together.

    ``level``, ``move``, ``target``, ``mask`` (B, T, R), the mask 1 where there is a sample and 0
    where a segment is padded; ``before`` and ``last`` (B, R), the measured positions two and one
    samples before each segment.
    """

    level: Tensor
    move: Tensor
    target: Tensor
    mask: Tensor
    before: Tensor
    last: Tensor


@dataclass(frozen=True, kw_only=True)
class Clamps:
    """(B, 1) each: the clamps of a run, and ``ratio`` = se / sd."""

    error_low: Tensor
    error_high: Tensor
    slowest: Tensor
    fastest: Tensor
    low: Tensor
    high: Tensor
    ratio: Tensor


@dataclass(frozen=True, kw_only=True)
class Weights:
    """(B, P) taken apart: ``value`` (B, H + 5), ``gate`` (B, H + 1), ``rows`` (B, H, 5)."""

    value: Tensor
    gate: Tensor
    rows: Tensor

    @classmethod
    def split(cls, flat: Tensor, hidden: int) -> Weights:
        """``flat`` (B, P), in the kernel's order, of networks with so many hidden units."""
        gate = hidden + INPUTS + 1
        rows = gate + hidden + 1
        return cls(
            value=flat[:, :gate],
            gate=flat[:, gate:rows],
            rows=flat[:, rows:].reshape(-1, hidden, INPUTS + 1),
        )

    @property
    def outputs(self) -> Tensor:
        """(B, H + 5, 2): the linear map from ``[h, x, 1]`` to the value and the gate's opening."""
        gate = torch.zeros_like(self.value)
        hidden = self.rows.shape[1]
        gate[:, :hidden], gate[:, -1] = self.gate[:, :hidden], self.gate[:, hidden]
        return torch.stack([self.value, gate], dim=2)


@dataclass(frozen=True, kw_only=True)
class SimulatedBlock:
    """A block simulated: ``units`` (B, T, R, H + 5) = ``[h, x, 1]``, ``outputs`` (B, T, R, 2) the
    value and the gate's opening, ``position`` (B, T, R), and ``error_free``, ``step_free`` and
    ``position_free`` (B, T, R), 1 where the clamp did not act and 0 where it did."""

    units: Tensor
    outputs: Tensor
    position: Tensor
    error_free: Tensor
    step_free: Tensor
    position_free: Tensor


def simulate(block: SegmentBlock, weights: Weights, clamps: Clamps) -> SimulatedBlock:
    """Every segment's free run, one step of all segments at a time."""
    hidden, shape = weights.rows.shape[1], block.level.shape
    units = block.level.new_empty(*shape, hidden + INPUTS + 1)
    units[..., hidden + 1], units[..., -1] = block.move, 1.0
    heading = 0.5 * torch.tanh(block.move / EDGE)
    outputs = block.level.new_empty(*shape, 2)
    position, raw, step, error = (torch.empty_like(block.level) for _ in range(4))
    inwards, outwards = weights.rows.transpose(1, 2).contiguous(), weights.outputs
    before, last = block.before, block.last
    for t in range(shape[1]):
        now, x = units[:, t], units[:, t, :, hidden:]
        torch.sub(block.level[:, t], last, out=error[:, t])
        torch.clamp(error[:, t], clamps.error_low, clamps.error_high, out=x[..., 0])
        torch.mul(last - before, clamps.ratio, out=x[..., 2])
        torch.add(heading[:, t], torch.tanh(x[..., 2] / EDGE), alpha=0.5, out=x[..., 3])
        now[..., :hidden] = torch.bmm(x, inwards).tanh_()
        outputs[:, t] = torch.bmm(now, outwards)
        torch.mul(torch.sigmoid(outputs[:, t, :, 1]), outputs[:, t, :, 0], out=step[:, t])
        torch.add(last, step[:, t].clamp(clamps.slowest, clamps.fastest), out=raw[:, t])
        torch.clamp(raw[:, t], clamps.low, clamps.high, out=position[:, t])
        before, last = last, position[:, t]
    return SimulatedBlock(
        units=units,
        outputs=outputs,
        position=position,
        error_free=_unclamped(error, clamps.error_low, clamps.error_high),
        step_free=_unclamped(step, clamps.slowest, clamps.fastest),
        position_free=_unclamped(raw, clamps.low, clamps.high),
    )


def _unclamped(values: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """1 where ``values`` (B, T, R) lie within their clamp, 0 elsewhere."""
    return ((values >= low[:, None]) & (values <= high[:, None])).to(values.dtype)


def jacobian(block: SegmentBlock, run: SimulatedBlock, weights: Weights, clamps: Clamps) -> Tensor:
    """(B, T R, P + 1): ``d y(t) / d w``, and in the last column the residual ``y(t) - MV(t)``.

    With ``g`` the derivative of one step by a weight, and ``d1``, ``d2`` those by the last two
    positions, ``s(t) = g(t) + d1 s(t-1) + d2 s(t-2)``, carried forward from 0 at each segment's
    start.
    """
    nets, steps, rows = block.level.shape
    s, d1, d2 = _one_step(block, run, weights, clamps)
    torch.sub(run.position, block.target, out=s[..., -1]).mul_(block.mask)
    carried = s[..., :-1]
    for t in range(1, steps):
        carried[:, t].addcmul_(d1[:, t], carried[:, t - 1])
        if t > 1:
            carried[:, t].addcmul_(d2[:, t], carried[:, t - 2])
        carried[:, t].clamp_(-LIMIT, LIMIT)
    return s.view(nets, steps * rows, -1)


def normal_matrix(segment_blocks: list[SegmentBlock], weights: Weights, clamps: Clamps) -> Tensor:
    """(B, P + 1, P + 1): ``J'J`` with ``J'r`` as its last column and ``r'r`` in its corner."""
    total: Tensor | None = None
    for block in segment_blocks:
        J = jacobian(block, simulate(block, weights, clamps), weights, clamps)
        part = torch.bmm(J.transpose(1, 2), J)
        total = part if total is None else total.add_(part)
    if total is None:
        raise ValueError("at least one block of segments expected, received none")
    return total


def recorded(normal: Callable[[Tensor], Tensor], weights: Tensor) -> Callable[[Tensor], Tensor]:
    """``normal`` of weights (B, P), its kernels recorded as one CUDA graph on a GPU.

    A free run is hundreds of steps one after the other, each of a dozen small kernels. Started one
    by one they cost ten times as long as they take; a graph starts them all at once. ``weights``
    are any of the right shape, to record with. On other devices ``normal`` itself is returned.
    """
    if weights.device.type != "cuda":
        return normal
    given = weights.clone()
    beside = torch.cuda.Stream(weights.device)  # type: ignore[no-untyped-call]
    beside.wait_stream(torch.cuda.current_stream(weights.device))
    with torch.cuda.stream(beside):
        normal(given)  # libraries take their memory before a recording begins
    torch.cuda.current_stream(weights.device).wait_stream(beside)
    graph = torch.cuda.CUDAGraph()
    with torch.cuda.graph(graph):
        answer = normal(given)

    def replay(flat: Tensor) -> Tensor:
        given.copy_(flat)
        graph.replay()
        return answer.clone()

    return replay


def _one_step(
    block: SegmentBlock, run: SimulatedBlock, weights: Weights, clamps: Clamps
) -> tuple[Tensor, Tensor, Tensor]:
    """``g`` (B, T, R, P + 1; the last column unset), ``d1`` and ``d2`` (B, T, R, 1).

    All three are 0 where the position is clamped or the segment padded: nothing goes on from there.
    """
    hidden = weights.rows.shape[1]
    value, gate = run.outputs[..., 0], torch.sigmoid(run.outputs[..., 1])
    live = run.position_free * block.mask
    by_value = gate * live * run.step_free
    by_gate = by_value * value * (1.0 - gate)
    by_hidden = _through_hidden(run, weights, by_value, by_gate)
    by_x = torch.matmul(by_hidden, weights.rows[:, None, :, :INPUTS])
    by_x += by_value[..., None] * weights.value[:, None, None, hidden : hidden + INPUTS]
    turning = 2.0 * run.units[..., hidden + 3] - torch.tanh(block.move / EDGE)
    by_drift = by_x[..., 2] + by_x[..., 3] * (1.0 - turning * turning) * (0.5 / EDGE)
    d2 = -by_drift * clamps.ratio[:, None]
    d1 = live - by_x[..., 0] * run.error_free - d2
    return _by_weights(run, by_value, by_gate, by_hidden), d1[..., None], d2[..., None]


def _by_weights(
    run: SimulatedBlock, by_value: Tensor, by_gate: Tensor, by_hidden: Tensor
) -> Tensor:
    """``g``: one step's derivative by each weight, in the kernel's order, and an unset column."""
    hidden, inputs = by_hidden.shape[-1], INPUTS + 1
    value, gate = hidden + inputs, hidden + 1
    g = run.units.new_empty(*by_value.shape, _sensitivities(hidden))
    torch.mul(run.units, by_value[..., None], out=g[..., :value])
    torch.mul(run.units[..., :hidden], by_gate[..., None], out=g[..., value : value + hidden])
    g[..., value + hidden] = by_gate
    rows = g[..., value + gate : -1].view(*by_value.shape, hidden, inputs)
    torch.mul(by_hidden[..., None], run.units[..., None, hidden:], out=rows)
    return g


def _sensitivities(hidden: int) -> int:
    """P + 1: one by each weight of a network of so many hidden units, and the residual."""
    return (hidden + INPUTS + 1) + (hidden + 1) + hidden * (INPUTS + 1) + 1


def _through_hidden(
    run: SimulatedBlock, weights: Weights, by_value: Tensor, by_gate: Tensor
) -> Tensor:
    """(B, T, R, H): the derivative of the position by each hidden unit's sum."""
    hidden = weights.rows.shape[1]
    h = run.units[..., :hidden]
    through = by_value[..., None] * weights.value[:, None, None, :hidden]
    through += by_gate[..., None] * weights.gate[:, None, None, :hidden]
    return through.mul_(1.0 - h * h)


# Sensitivities in a block, of all networks together: 512 MB of them, and about as much again of
# what they are made from. A GPU does each step of a run on all segments of a block in the same
# time, however many they are, so that few large blocks are quickest.
_MOST_SENSITIVITIES = 2**26

_Columns = tuple[Floats, Floats, Floats, Floats, Floats, Floats]


def segment_blocks(
    valves: Sequence[TrainingRecord], horizon: int, hidden: int, seeds: int, device: str
) -> list[SegmentBlock]:
    """Every valve's training segments of ``horizon`` samples, for networks of ``hidden`` units.

    Networks are ordered valve by valve, each valve's seeds together.
    """
    cuts = [segments(valve.trained, horizon) for valve in valves]
    most_segments = max(1, *(starts.size for starts, _ in cuts))
    of_one_row = len(valves) * seeds * horizon * _sensitivities(hidden)
    blocks = -(-most_segments // max(1, _MOST_SENSITIVITIES // of_one_row))
    rows = -(-most_segments // blocks)
    total = rows * blocks
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


def clamps(valves: Sequence[TrainingRecord], seeds: int, device: str) -> Clamps:
    """The clamps of each network."""
    table = torch.tensor([(*valve.limits, valve.ratio) for valve in valves], dtype=torch.float64)
    columns = table.repeat_interleave(seeds, dim=0).to(device)
    names = ("error_low", "error_high", "slowest", "fastest", "low", "high", "ratio")
    return Clamps(**{name: columns[:, [column]] for column, name in enumerate(names)})


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
    before, last = (
        np.where(real, signals.position[first - samples_back], 0.0) for samples_back in (2, 1)
    )
    return level, move, target, mask, before, last


def _block(piece: Sequence[Tensor]) -> SegmentBlock:
    names = ("level", "move", "target", "mask", "before", "last")
    contiguous = (tensor.contiguous() for tensor in piece)
    return SegmentBlock(**dict(zip(names, contiguous, strict=True)))
