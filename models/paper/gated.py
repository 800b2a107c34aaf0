"""Our network: a gated increment of 35 weights, and how its start is set from S and J."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from stemwatch.models.recording import Floats

HIDDEN = 5
INPUTS = 3
_ROWS = HIDDEN * (INPUTS + 1)
_GATE = HIDDEN + 1
WEIGHTS = _ROWS + _GATE + HIDDEN + INPUTS + 1

_UP, _DOWN, _GOES_ON_UP, _GOES_ON_DOWN, _DIRECTION = range(HIDDEN)


@dataclass(frozen=True, kw_only=True)
class GatedStep:
    """``y(t) = y(t-1) + se sigmoid(wg.h + bg) (wv.h + c.x + bv)`` with ``h = tanh(W x + b)``.

    ``x = [e/se, tanh(du/(eps se)), tanh(dy1/(eps se))]``; ``e = u(t) - y(t-1)``, ``du = u(t) -
    u(t-1)``, ``dy1 = y(t-1) - y(t-2)``. ``se`` = std(e) of the training record. The two saturated
    regressors say which way the command and the stem go, however slowly: near a turning point a
    motion that is taken for rest costs the next slip. Weights: rows [W, b], gate, value [wv, c,
    bv], flattened.
    """

    se: float
    eps: float

    def __call__(self, weights: Tensor, lags: Tensor) -> Tensor:
        u0, u1, _, y1, y2 = lags.unbind(-1)
        sharp = 1.0 / (self.eps * self.se)
        x = torch.stack(
            [(u0 - y1) / self.se, torch.tanh((u0 - u1) * sharp), torch.tanh((y1 - y2) * sharp)],
            dim=-1,
        )
        rows = weights[:, :_ROWS].reshape(-1, HIDDEN, INPUTS + 1)
        gate = weights[:, _ROWS : _ROWS + _GATE]
        value = weights[:, _ROWS + _GATE :]
        inwards = torch.matmul(x, rows[..., :INPUTS].transpose(1, 2))
        h = torch.tanh(inwards + rows[:, None, :, INPUTS])
        opening = torch.matmul(h, gate[:, :HIDDEN, None])[..., 0] + gate[:, HIDDEN:]
        seen = torch.cat([h, x], dim=-1)
        moved = torch.matmul(seen, value[:, :-1, None])[..., 0] + value[:, -1:]
        return y1 + self.se * torch.sigmoid(opening) * moved


def error_scale(u: Floats, y: Floats) -> float:
    """``se``: the standard deviation of ``u(t) - y(t-1)``."""
    return float(np.std(u[1:] - y[:-1]))


def start_from(S: float, J: float, se: float, width: float) -> Floats:
    """(35,) weights that reproduce the element with this S and J, but for edges of ``width``.

    With ``fs = (S + J)/2`` and ``fd = (S - J)/2``: one unit opens the gate where ``e > fs``, one
    where ``e < -fs``, two where command and stem both go on in one direction; the fifth is the
    direction d, and the value is ``e - d fd``. Between two directions ``e/fs`` decides: whoever
    goes on upwards has ``e >= fd > -fs``, also where fd is negative (overshoot). ``width`` is in
    the unit of S; the smaller, the sharper the edge, and the less gradient it has.
    """
    fs, fd = 0.5 * (S + J) / se, 0.5 * (S - J) / se
    steep = se / width
    rows = np.zeros((HIDDEN, INPUTS + 1))
    rows[_UP] = steep, 0.0, 0.0, -steep * fs
    rows[_DOWN] = -steep, 0.0, 0.0, -steep * fs
    rows[_GOES_ON_UP] = 0.0, 20.0, 20.0, -30.0
    rows[_GOES_ON_DOWN] = 0.0, -20.0, -20.0, -30.0
    rows[_DIRECTION] = 10.0 / fs, 10.0, 10.0, 0.0
    gate = np.array([30.0, 30.0, 30.0, 30.0, 0.0, 90.0])
    value = np.zeros(HIDDEN + INPUTS + 1)
    value[_DIRECTION], value[HIDDEN] = -fd, 1.0
    return np.concatenate([rows.ravel(), gate, value])


def random_start(rng: np.random.Generator) -> Floats:
    """(35,) weights that know nothing.

    Rows normal / sqrt(3) times 1.5, their biases normal, gate normal / sqrt(5), value small.
    """
    rows = rng.standard_normal((HIDDEN, INPUTS + 1))
    rows[:, :INPUTS] *= 1.5 / np.sqrt(INPUTS)
    gate = rng.standard_normal(_GATE) / np.sqrt(HIDDEN)
    value = 0.1 * rng.standard_normal(HIDDEN + INPUTS + 1)
    return np.concatenate([rows.ravel(), gate, value])


def sharpened(weights: Floats, factor: float) -> Floats:
    """The weights with both breakaway edges so many times as steep, where they are."""
    sharp = weights.copy()
    sharp[:, : 2 * (INPUTS + 1)] *= factor
    return sharp
