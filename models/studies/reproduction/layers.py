"""The paper's networks: three layers each, with the transfer functions of its Table 1."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import torch
from torch import Tensor

from stemwatch.models.recording import Floats
from stemwatch.models.studies.reproduction import kernel
from stemwatch.models.verdict import Shape

# The paper does not give the layers' sizes; these are ours.
SIZES = (10, 10, 1)


class Transfer(StrEnum):
    """A layer's transfer function, by its name in Table 1."""

    LOG_SIGMOID = "log sigmoid"
    TANGENT_SIGMOID = "tangent sigmoid"
    LINEAR = "linear"


def _identity(x: Tensor) -> Tensor:
    return x


_FUNCTION: dict[Transfer, Callable[[Tensor], Tensor]] = {
    Transfer.LOG_SIGMOID: torch.sigmoid,
    Transfer.TANGENT_SIGMOID: torch.tanh,
    Transfer.LINEAR: _identity,
}
_CODE = {
    Transfer.LOG_SIGMOID: kernel.LOG_SIGMOID,
    Transfer.TANGENT_SIGMOID: kernel.TANGENT_SIGMOID,
    Transfer.LINEAR: kernel.LINEAR,
}
_LOG, _TAN, _LIN = Transfer.LOG_SIGMOID, Transfer.TANGENT_SIGMOID, Transfer.LINEAR

FEEDFORWARD = {
    Shape.DEADBAND: (_LOG, _TAN, _LIN),
    Shape.UNDERSHOOT: (_LOG, _LIN, _LOG),
    Shape.NO_OFFSET: (_LIN, _LIN, _LOG),
    Shape.OVERSHOOT: (_LIN, _LIN, _LOG),
}
NARX = {
    Shape.DEADBAND: (_LIN, _LOG, _LIN),
    Shape.UNDERSHOOT: (_LOG, _LIN, _LOG),
    Shape.NO_OFFSET: (_LIN, _LIN, _LIN),
    Shape.OVERSHOOT: (_LIN, _TAN, _LIN),
}

# Places in ``network_step.LAGS``. The paper does not give the inputs of the feedforward network; it
# has the command alone here, because the paper's errors and CDC are those of a static map. NARX as
# in the paper's equation (1), which has no u(t), with two lags each.
FEEDFORWARD_INPUTS = (0,)
NARX_INPUTS = (1, 2, 3, 4)


@dataclass(frozen=True, kw_only=True)
class ThreeLayers:
    """``y = f3(W3 f2(W2 f1(W1 x + b1) + b2) + b3)``, signals scaled by ``reach`` = max |y| or |u|.

    Inputs are scaled to -1 ... 1. The target is scaled to -0.8 ... 0.8, or to 0.1 ... 0.9 where the
    last layer is a log sigmoid, whose output lies within 0 ... 1. Weights: [W1, b1], [W2, b2], [W3,
    b3], flattened.
    """

    transfers: tuple[Transfer, Transfer, Transfer]
    inputs: tuple[int, ...]
    reach: float
    sizes: tuple[int, int, int] = SIZES

    def __call__(self, weights: Tensor, lags: Tensor) -> Tensor:
        signal = lags[..., list(self.inputs)] / self.reach
        first = 0
        for width, transfer in zip(self.sizes, self.transfers, strict=True):
            wide = signal.shape[-1] + 1
            matrix = weights[:, first : first + width * wide].reshape(-1, width, wide)
            summed = torch.matmul(signal, matrix[..., :-1].transpose(1, 2))
            signal = _FUNCTION[transfer](summed + matrix[:, None, :, -1])
            first += width * wide
        reach, centre, share = self._scale
        return reach * (signal[..., 0] - centre) / share

    def runs(self, weights: Floats, u: Floats, y: Floats, limit: float) -> Floats:
        """(T, R) free runs, held within ``-limit`` to ``limit``."""
        sizes, codes, inputs = self._for_kernel
        out = np.empty(u.shape)
        kernel.free_runs(weights, sizes, codes, inputs, self._scale, u, y, limit, out)
        return out

    def jacobian(
        self, weights: Floats, u: Floats, y: Floats, limit: float, steepest: float
    ) -> Floats:
        """(R (T - 2), P + 1) derivatives of the runs by each weight, and last the residuals."""
        sizes, codes, inputs = self._for_kernel
        out = np.empty(((u.shape[0] - 2) * u.shape[1], weights.size + 1))
        kernel.jacobian(weights, sizes, codes, inputs, self._scale, u, y, limit, steepest, out)
        return out

    @property
    def _scale(self) -> tuple[float, float, float]:
        """Reach, and the target's centre and share, as the kernel takes them."""
        return (self.reach, 0.5, 0.4) if self.transfers[-1] is _LOG else (self.reach, 0.0, 0.8)

    @property
    def _for_kernel(self) -> tuple[kernel.Indices, kernel.Indices, kernel.Indices]:
        """Sizes, codes and inputs, as ``kernel`` takes them."""
        return (
            np.array([len(self.inputs), *self.sizes]),
            np.array([_CODE[transfer] for transfer in self.transfers]),
            np.array(self.inputs),
        )

    @property
    def shapes(self) -> tuple[tuple[int, int], ...]:
        """(units, inputs + 1) of each layer."""
        before = (len(self.inputs), *self.sizes[:-1])
        return tuple((size, last + 1) for size, last in zip(self.sizes, before, strict=True))

    def random_start(self, rng: np.random.Generator) -> Floats:
        """(P,) weights: normal / sqrt(inputs of the layer), the first layer three times as wide."""
        parts = [
            (3.0 if index == 0 else 1.0) * rng.standard_normal(shape) / np.sqrt(shape[1])
            for index, shape in enumerate(self.shapes)
        ]
        return np.concatenate([part.ravel() for part in parts])
