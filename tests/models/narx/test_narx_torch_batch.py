"""The batched torch run and its forward sensitivities, against autograd and against the kernel."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from stemwatch.models.narx import kernel
from stemwatch.models.narx.levenberg_marquardt import one_thread
from stemwatch.models.narx.run_plan import plan_run
from stemwatch.models.narx.torch_batch import (
    Clamps,
    SegmentBlock,
    Weights,
    jacobian,
    normal_matrix,
    simulate,
)

HIDDEN, NETS, STEPS, ROWS, SIZE = 5, 3, 40, 4, 41
WIDE = (-50.0, 50.0, -50.0, 50.0, -50.0, 50.0)
NARROW = (-1.4, 1.5, -0.4, 0.3, -0.8, 0.9)


def block(seed: int = 0) -> SegmentBlock:
    """Random segments, the last two of them padded."""
    make = np.random.default_rng(seed)
    level, move, target = (torch.from_numpy(make.normal(size=(NETS, STEPS, ROWS))) for _ in "lmt")
    mask = torch.ones(NETS, STEPS, ROWS, dtype=torch.float64)
    mask[:, 25:, 2], mask[:, :, 3] = 0.0, 0.0
    before, last = (torch.from_numpy(0.3 * make.normal(size=(NETS, ROWS))) for _ in "bl")
    return SegmentBlock(level=level, move=move, target=target, mask=mask, before=before, last=last)


def bounds(limits: tuple[float, ...]) -> Clamps:
    names = ("error_low", "error_high", "slowest", "fastest", "low", "high", "ratio")
    columns = [torch.full((NETS, 1), value, dtype=torch.float64) for value in (*limits, 1.7)]
    return Clamps(**dict(zip(names, columns, strict=True)))


def flat_weights(seed: int = 5) -> torch.Tensor:
    """Random networks that drive the position towards the command, so that runs stay bounded."""
    flat = torch.from_numpy(0.4 * np.random.default_rng(seed).standard_normal((NETS, SIZE)))
    flat[:, 5] = 0.8
    return flat


def autograd_run(
    w: torch.Tensor, piece: SegmentBlock, net: int, row: int, limits: tuple[float, ...]
):  # type: ignore[no-untyped-def]
    """The network's equations for one segment, with a graph, written without the batch."""
    value, gate, rows = w[:10], w[10:16], w[16:].reshape(5, 5)
    before, last = piece.before[net, row], piece.last[net, row]
    out = []
    for t in range(STEPS):
        error = torch.clamp(piece.level[net, t, row] - last, limits[0], limits[1])
        ways = torch.stack([piece.move[net, t, row], 1.7 * (last - before)])
        x = torch.cat([error[None], ways, torch.tanh(ways / 0.01).mean(0, keepdim=True)])
        h = torch.tanh(rows[:, :4] @ x + rows[:, 4])
        step = torch.sigmoid(gate[:5] @ h + gate[5]) * (value[:5] @ h + value[5:9] @ x + value[9])
        new = torch.clamp(last + torch.clamp(step, limits[2], limits[3]), limits[4], limits[5])
        before, last = last, new
        out.append(new)
    return torch.stack(out)


@pytest.mark.long
@pytest.mark.parametrize("limits", [WIDE, NARROW], ids=["free", "clamped"])
def test_carried_sensitivities_are_what_autograd_finds(limits: tuple[float, ...]) -> None:
    """Through tanh, gate, both lags and every clamp, dy/dw is the derivative of the run."""
    piece, flat = block(), flat_weights()
    weights, clamps = Weights.split(flat, HIDDEN), bounds(limits)
    run = simulate(piece, weights, clamps)
    acted = [bool((free == 0).any()) for free in (run.error_free, run.step_free, run.position_free)]
    assert acted == [limits is NARROW] * 3
    J = jacobian(piece, run, weights, clamps).view(NETS, STEPS, ROWS, SIZE + 1)
    largest = 0.0
    for net, row in ((0, 0), (1, 1), (2, 2)):
        expected = torch.autograd.functional.jacobian(
            lambda w, net=net, row=row: autograd_run(w, piece, net, row, limits), flat[net]
        )
        real = piece.mask[net, :, row] > 0
        torch.testing.assert_close(J[net, real, row, :SIZE], expected[real], rtol=1e-9, atol=1e-11)
        largest = max(largest, float(expected[real].abs().max()))
    assert largest > 0.1


def test_padded_samples_have_no_weight() -> None:
    """The normal matrix of padded segments is that of their real samples."""
    piece, weights, clamps = block(), Weights.split(flat_weights(), HIDDEN), bounds(WIDE)
    J = jacobian(piece, simulate(piece, weights, clamps), weights, clamps)
    J = J.view(NETS, STEPS, ROWS, SIZE + 1)
    assert float(J[:, 25:, 2].abs().max()) == 0.0
    assert float(J[:, :, 3].abs().max()) == 0.0
    real = torch.cat([J[:, :, :2].flatten(1, 2), J[:, :25, 2]], dim=1)
    expected = real.transpose(1, 2) @ real
    torch.testing.assert_close(normal_matrix([piece], weights, clamps), expected)


@pytest.mark.parametrize("limits", [WIDE, NARROW], ids=["free", "clamped"])
def test_torch_and_the_kernel_run_the_same_network(limits: tuple[float, ...]) -> None:
    """What is trained in torch is what is run in numba."""
    piece, flat = block(), flat_weights()
    run = simulate(piece, Weights.split(flat, HIDDEN), bounds(limits))
    plan = plan_run(np.ones(STEPS + 2, dtype=bool))
    for net, row in ((0, 0), (2, 1)):
        start = np.array([piece.before[net, row], piece.last[net, row]])
        level, move = (
            np.concatenate([[0.0, 0.0], signal[net, :, row].numpy()])
            for signal in (piece.level, piece.move)
        )
        position = np.concatenate([start, np.zeros(STEPS)])
        out = np.full((1, STEPS + 2), np.nan)
        kernel.free_run(
            flat[[net]].numpy(),
            HIDDEN,
            level,
            move,
            position,
            plan,
            (1, 2, 3),
            limits,
            1.7,
            0.01,
            out,
        )
        np.testing.assert_allclose(
            out[0, 2:], run.position[net, :, row].numpy(), rtol=0, atol=1e-12
        )


def test_a_diverging_run_keeps_its_sensitivities_finite() -> None:
    """Weights far too large give a poor step, not a matrix full of NaN."""
    weights = Weights.split(40.0 * flat_weights(), HIDDEN)
    assert bool(torch.isfinite(normal_matrix([block()], weights, bounds(WIDE))).all())


def test_the_number_of_torch_threads_is_given_back() -> None:
    """Training uses one thread and leaves the process as it found it, also after an error."""
    num_threads = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with pytest.raises(RuntimeError, match="1 thread inside"), one_thread():
            raise RuntimeError(f"{torch.get_num_threads()} thread inside")
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(num_threads)
