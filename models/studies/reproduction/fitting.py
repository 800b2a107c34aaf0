"""Levenberg-Marquardt on free runs of any ``NetworkStep``, over a horizon that grows from 1.

Horizon 1 is series-parallel: every sample is predicted from true ones. Derivatives of one step
come from torch, or from the step's own kernel where it has one; through a run they are carried
forward, ``s(t) = g(t) + d1 s(t-1) + d2 s(t-2)``, so that no graph is unrolled.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.func import grad, vmap

from stemwatch.models.narx.levenberg_marquardt import descend
from stemwatch.models.recording import Floats
from stemwatch.models.studies.reproduction.network_step import (
    LIMIT,
    SEEDS,
    Compiled,
    NetworkStep,
    run_free,
)

_SENSITIVITY_LIMIT = 1e4  # far beyond any useful gradient: a diverging run must not fill J'J
_JUDGED = 600  # samples of the free runs by which weights are chosen
_PIECE = 16_000  # single steps, of all networks together


@dataclass(frozen=True, kw_only=True)
class TrainingStage:
    """Free runs of ``horizon`` samples, and at most so many steps on them."""

    horizon: int
    steps: int
    damping: float = 1e-2
    decay: float = 1e-6


@dataclass(frozen=True, kw_only=True)
class Segments:
    """A record cut into runs: ``u`` and ``y`` (horizon + 2, R), the first two samples the seeds."""

    u: Tensor
    y: Tensor

    @classmethod
    def cut(cls, u: Floats, y: Floats, horizon: int) -> Segments:
        """Runs of ``horizon`` samples from a record (n,); a remainder at its end is not used."""
        starts = np.arange(SEEDS, u.size - horizon + 1, horizon)
        index = starts[None, :] + np.arange(-SEEDS, horizon)[:, None]
        return cls(u=torch.from_numpy(u[index]), y=torch.from_numpy(y[index]))

    @property
    def samples(self) -> int:
        """How many samples are fitted to in all."""
        return (self.u.shape[0] - SEEDS) * self.u.shape[1]


def fit_stage(
    step: NetworkStep, weights: Floats, u: Floats, y: Floats, stage: TrainingStage
) -> Floats:
    """(B, P) weights after the stage on a record (n,): ``fit_segments`` with relative changes."""
    return fit_segments(step, weights, Segments.cut(u, y, stage.horizon), stage, relative=True)


def fit_segments(
    step: NetworkStep, weights: Floats, cut: Segments, stage: TrainingStage, *, relative: bool
) -> Floats:
    """(B, P) weights after the stage; each network has its own damping and its own stop.

    The search is over each weight's change, and decay pulls this change to 0, not the weight: a
    steep edge keeps its large weights, and a saturated unit, which the data do not determine, stays
    as it is. ``relative``: changes are in units of ``max(|weight|, 1)``.
    """
    centre = torch.from_numpy(weights)
    unit = centre.abs().clamp(min=1.0) if relative else torch.ones_like(centre)
    scale = torch.cat([unit, torch.ones_like(unit[:, :1])], dim=1)

    def normal(change: Tensor, _: Tensor) -> Tensor:
        normal = normal_matrix(step, centre + unit * change, cut)
        return scale[:, :, None] * normal * scale[:, None, :]

    descent = descend(
        torch.zeros_like(centre),
        normal,
        torch.full((centre.shape[0],), float(cut.samples), dtype=torch.float64),
        steps=stage.steps,
        damping=stage.damping,
        decay=stage.decay,
        watch=lambda _, improved: torch.ones_like(improved),
    )
    return np.asarray((centre + unit * descent.weights).numpy())


def normal_matrix(step: NetworkStep, weights: Tensor, cut: Segments) -> Tensor:
    """(B, P + 1, P + 1): ``J'J`` with ``J'r`` as its last column and ``r'r`` in its corner."""
    if isinstance(step, Compiled):
        return torch.stack([_squared(step, weight, cut) for weight in weights.numpy()])
    with torch.no_grad():
        y = _runs(step, weights, cut)
    lags = _lags(cut.u, y)
    nets, horizon, rows, _ = lags.shape
    by_weights, by_lags = _derivatives(step, weights, lags.reshape(nets, horizon * rows, -1))
    s = by_weights.reshape(nets, horizon, rows, -1)
    d1, d2 = (by_lags[..., lag].reshape(nets, horizon, rows, 1) for lag in (3, 4))
    _carry(s, d1, d2)
    residual = _answers(step, weights, lags, y, cut)
    J = torch.cat([s, residual[..., None]], dim=-1).reshape(nets, horizon * rows, -1)
    return torch.bmm(J.transpose(1, 2), J)


def _squared(step: Compiled, weights: Floats, cut: Segments) -> Tensor:
    """(P + 1, P + 1) of one network; at horizon 1 the output is not clamped, so that its error
    still has a gradient.
    """
    limit = LIMIT if cut.u.shape[0] > SEEDS + 1 else np.inf
    J = step.jacobian(weights, cut.u.numpy(), cut.y.numpy(), limit, _SENSITIVITY_LIMIT)
    return torch.from_numpy(J.T) @ torch.from_numpy(J)


def _runs(step: NetworkStep, weights: Tensor, cut: Segments) -> Tensor:
    """(B, horizon + 2, R); at horizon 1 nothing is fed back and there is nothing to run."""
    if cut.u.shape[0] == SEEDS + 1:
        return cut.y.expand(weights.shape[0], -1, -1)
    return run_free(step, weights, cut.u, cut.y)


def _answers(step: NetworkStep, weights: Tensor, lags: Tensor, y: Tensor, cut: Segments) -> Tensor:
    """(B, horizon, R) residuals of the run."""
    if cut.u.shape[0] > SEEDS + 1:
        return y[:, SEEDS:] - cut.y[SEEDS:]
    return step(weights, lags[:, 0])[:, None] - cut.y[SEEDS:]


def _lags(u: Tensor, y: Tensor) -> Tensor:
    """(B, horizon, R, 5) from ``u`` (horizon + 2, R) and ``y`` (B, horizon + 2, R)."""
    columns = [u[2:], u[1:-1], u[:-2]]
    commands = torch.stack(columns, dim=-1).expand(y.shape[0], -1, -1, -1)
    return torch.cat([commands, torch.stack([y[:, 1:-1], y[:, :-2]], dim=-1)], dim=-1)


def _derivatives(step: NetworkStep, weights: Tensor, lags: Tensor) -> tuple[Tensor, Tensor]:
    """``d y / d weights`` (B, N, P) and ``d y / d lags`` (B, N, 5) of single steps."""

    def output_of_sample(flat: Tensor, sample: Tensor) -> Tensor:
        return step(flat[None], sample[None, None])[0, 0]

    gradients = vmap(vmap(grad(output_of_sample, argnums=(0, 1)), in_dims=(None, 0)))
    # In pieces that stay in the processor's cache: all at once takes ten times as long.
    length = _PIECE // weights.shape[0] + 1
    pieces = [gradients(weights, piece) for piece in torch.split(lags, length, dim=1)]
    by_weights, by_lags = (torch.cat(part, dim=1) for part in zip(*pieces, strict=True))
    return by_weights, by_lags


def _carry(s: Tensor, d1: Tensor, d2: Tensor) -> None:
    """``s`` (B, horizon, R, P) from one-step derivatives to those of the run, in place."""
    for t in range(1, s.shape[1]):
        s[:, t].addcmul_(d1[:, t], s[:, t - 1])
        if t > 1:
            s[:, t].addcmul_(d2[:, t], s[:, t - 2])
        s[:, t].clamp_(-_SENSITIVITY_LIMIT, _SENSITIVITY_LIMIT)


def run_errors(step: NetworkStep, weights: Floats, u: Floats, y: Floats) -> Floats:
    """(B,) RMSE of free runs of at most ``_JUDGED`` samples over a record."""
    return segment_errors(step, weights, Segments.cut(u, y, min(_JUDGED, u.size - SEEDS)))


def segment_errors(step: NetworkStep, weights: Floats, cut: Segments) -> Floats:
    """(B,) RMSE of the free runs over every segment, in the unit of ``cut``."""
    with torch.inference_mode():
        runs = run_free(step, torch.from_numpy(weights), cut.u, cut.y)[:, SEEDS:]
        return np.asarray((runs - cut.y[SEEDS:]).square().mean(dim=(1, 2)).sqrt().numpy())


def keep_best(step: NetworkStep, best: Floats, weights: Floats, u: Floats, y: Floats) -> Floats:
    """(B, P) for each network the weights with the better free run over the training record."""
    better = run_errors(step, weights, u, y) < run_errors(step, best, u, y)
    return np.where(better[:, None], weights, best)
