"""Levenberg-Marquardt for many networks at once: each has its own damping and its own stop.

Levenberg (1944), doi:10.1090/qam/10666; Marquardt (1963), doi:10.1137/0111030.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor

_MOST_DAMPING = 1e8  # a step at this damping changes nothing any more
_LEAST_DAMPING = 1e-10

# A function of weights (B, P) and the largest acceptable r'r (B,). It returns (B, P + 1, P + 1):
# J'J, with J'r in the last column and r'r in the corner. Where r'r is larger it may be inf, and the
# other numbers are not used.
Normal = Callable[[Tensor, Tensor], Tensor]


@dataclass(frozen=True, kw_only=True)
class Descent:
    """How far one stage went: ``weights`` (B, P), ``loss`` and ``steps`` (B,) accepted."""

    weights: Tensor
    loss: Tensor
    steps: Tensor


@contextmanager
def one_thread() -> Iterator[None]:
    """One torch thread inside: small batched steps on several threads stall on a busy machine."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def descend(
    weights: Tensor,
    normal: Normal,
    samples: Tensor,
    *,
    steps: int,
    damping: float,
    decay: float,
    watch: Callable[[Tensor, Tensor], Tensor],
) -> Descent:
    """Minimise ``r'r / samples + decay |w|^2 / P`` for each network.

    ``normal`` is a ``Normal`` (see there); ``samples`` (B,). The step solves ``(J'J + lambda
    diag(J'J)) dw = -J'r`` with decay in both; lambda falls to a quarter where the loss fell, and is
    four times as large where it did not. ``watch(weights, improved)`` is called after every step
    and returns (B,) True for the networks that may go on.
    """
    active = torch.ones_like(samples, dtype=torch.bool)
    no_bound = torch.full_like(samples, torch.inf)
    matrix, gradient, loss = _objective(normal(weights, no_bound), weights, samples, decay)
    lam, accepted = torch.full_like(loss, damping), torch.zeros_like(loss)
    for _ in range(steps):
        trial = weights + _step(matrix, gradient, lam)
        largest_squares = torch.where(active, (loss - _shrink(trial, decay)) * samples, -torch.inf)
        new = _objective(normal(trial, largest_squares), trial, samples, decay)
        improved = active & (new[2] < loss)
        weights, matrix, gradient, loss = (
            _choose(improved, new_value, old)
            for new_value, old in zip((trial, *new), (weights, matrix, gradient, loss), strict=True)
        )
        lam = torch.where(improved, lam / 4, lam * 4).clamp(_LEAST_DAMPING, _MOST_DAMPING)
        accepted += improved
        active = active & watch(weights, improved)
        if not bool(active.any()):
            break
    return Descent(weights=weights, loss=loss, steps=accepted)


def _objective(
    normal: Tensor, weights: Tensor, samples: Tensor, decay: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Half the Hessian (B, P, P), half the gradient (B, P) and the loss (B,)."""
    size = weights.shape[1]
    normal = normal / samples[:, None, None]
    shrink = decay / size
    matrix = normal[:, :size, :size] + shrink * torch.eye(size).to(weights)
    gradient = normal[:, :size, size] + shrink * weights
    return matrix, gradient, normal[:, size, size] + _shrink(weights, decay)


def _shrink(weights: Tensor, decay: float) -> Tensor:
    """(B,) what the weight decay adds to the loss."""
    return decay / weights.shape[1] * (weights * weights).sum(1)


def _step(matrix: Tensor, gradient: Tensor, lam: Tensor) -> Tensor:
    """(B, P); no step where the matrix cannot be factored, which then counts as a failure."""
    damped = matrix + torch.diag_embed(lam[:, None] * matrix.diagonal(dim1=1, dim2=2))
    factor, info = torch.linalg.cholesky_ex(damped)
    step = -torch.cholesky_solve(gradient[..., None], factor)[..., 0]
    good = (info == 0) & torch.isfinite(step).all(1)
    return torch.where(good[:, None], step, 0.0)


def _choose(chosen: Tensor, new_value: Tensor, old: Tensor) -> Tensor:
    return torch.where(chosen.view(-1, *[1] * (old.dim() - 1)), new_value, old)
