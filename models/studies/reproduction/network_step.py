"""``NetworkStep``: one step of a NARX model, ``y(t) = f(weights, lags)``, and its free run.

``lags`` are the last axis of a tensor, in the order of ``LAGS``; a network takes those it needs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from torch import Tensor

from stemwatch.models.recording import Floats

LAGS = ("u(t)", "u(t-1)", "u(t-2)", "y(t-1)", "y(t-2)")
COMMANDS = 3
LIMIT = 3.0  # of a run, in amplitudes of the sine: twice what any stem here reaches
SEEDS = 2  # a run needs y(t-1) and y(t-2)


class NetworkStep(Protocol):
    """``weights`` (B, P) of B networks of one form, ``lags`` (B, R, 5), answer (B, R)."""

    def __call__(self, weights: Tensor, lags: Tensor) -> Tensor: ...


@runtime_checkable
class Compiled(Protocol):
    """A step with compiled kernels, which need neither torch nor a graph at each sample.

    ``weights`` (P,) of one network, ``u`` and ``y`` (T, R) as in ``run_free``.
    """

    def runs(self, weights: Floats, u: Floats, y: Floats, limit: float) -> Floats:
        """(T, R) free runs, held within ``-limit`` to ``limit``."""
        ...

    def jacobian(
        self, weights: Floats, u: Floats, y: Floats, limit: float, steepest: float
    ) -> Floats:
        """(R (T - 2), P + 1): derivatives of the runs by each weight, and last the residuals."""
        ...


def run_free(step: NetworkStep, weights: Tensor, u: Tensor, y: Tensor) -> Tensor:
    """(B, T, R) free runs of B networks over R inputs, each fed its own output.

    ``u`` and ``y`` (T, R); of ``y`` only the first two samples are used, and are returned as they
    are. Runs are clamped to ``-LIMIT`` to ``LIMIT``, so that a diverging one has a finite error.
    """
    if isinstance(step, Compiled):
        pair = (u.numpy(), y.numpy())
        return torch.from_numpy(
            np.stack([step.runs(weight, *pair, LIMIT) for weight in weights.numpy()])
        )
    runs = [sample.expand(weights.shape[0], -1) for sample in y[:SEEDS]]
    for t in range(SEEDS, u.shape[0]):
        commands = torch.stack([u[t], u[t - 1], u[t - 2]], dim=-1).expand(
            weights.shape[0], -1, COMMANDS
        )
        fed_back = torch.stack([runs[-1], runs[-2]], dim=-1)
        answer = step(weights, torch.cat([commands, fed_back], dim=-1))
        runs.append(torch.nan_to_num(answer, nan=LIMIT).clamp(-LIMIT, LIMIT))
    return torch.stack(runs, dim=1)


def simulate(
    step: NetworkStep, weights: Floats, inputs: Sequence[Floats], truths: Sequence[Floats]
) -> Floats:
    """(B, inputs, n) free runs over inputs of one length, started from the first two samples."""
    u, y = (torch.from_numpy(_columns(signals)) for signals in (inputs, truths))
    with torch.inference_mode():
        runs = run_free(step, torch.from_numpy(weights), u, y)
    return runs.transpose(1, 2).contiguous().numpy()


def _columns(signals: Sequence[Floats]) -> Floats:
    return np.ascontiguousarray(np.stack(signals, axis=1))
