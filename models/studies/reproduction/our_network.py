"""Our network, a gated increment of 35 weights, trained from fitted S and J or at random."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.studies.reproduction.cases import INTERVAL_S
from stemwatch.models.studies.reproduction.fitting import TrainingStage, fit_stage, keep_best

HIDDEN = 5
INPUTS = 3
_ROWS = HIDDEN * (INPUTS + 1)
_GATE = HIDDEN + 1

_UP, _DOWN, _GOES_ON_UP, _GOES_ON_DOWN, _DIRECTION = range(HIDDEN)


@dataclass(frozen=True, kw_only=True)
class GatedStep:
    """``y(t) = y(t-1) + se sigmoid(wg.h + bg) (wv.h + c.x + bv)`` with ``h = tanh(W x + b)``.

    ``x = [e/se, tanh(du/(eps se)), tanh(dy1/(eps se))]``; ``e = u(t) - y(t-1)``, ``du = u(t) -
    u(t-1)``, ``dy1 = y(t-1) - y(t-2)``. ``se`` = std(e) of the training record. The two saturated
    regressors give the direction of command and stem at any speed: near a turning point, a motion
    mistaken for rest would make the next slip fail. Weights: rows [W, b], gate, value [wv, c, bv],
    flattened.
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
        units_and_inputs = torch.cat([h, x], dim=-1)
        moved = torch.matmul(units_and_inputs, value[:, :-1, None])[..., 0] + value[:, -1:]
        return y1 + self.se * torch.sigmoid(opening) * moved


def error_scale(u: Floats, y: Floats) -> float:
    """``se``: the standard deviation of ``u(t) - y(t-1)``."""
    return float(np.std(u[1:] - y[:-1]))


def start_from(S: float, J: float, se: float, width: float) -> Floats:
    """(35,) weights that reproduce the element with this S and J, except for edges of ``width``.

    With ``fs = (S + J)/2`` and ``fd = (S - J)/2``: one unit opens the gate where ``e > fs``, one
    where ``e < -fs``, two where command and stem both go on in one direction; the fifth is the
    direction d, and the value is ``e - d fd``. Between two directions ``e/fs`` decides: a stem that
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
    """(35,) random weights, without knowledge of S and J.

    Rows normal / sqrt(3) times 1.5, their biases normal, gate normal / sqrt(5), value small.
    """
    rows = rng.standard_normal((HIDDEN, INPUTS + 1))
    rows[:, :INPUTS] *= 1.5 / np.sqrt(INPUTS)
    gate = rng.standard_normal(_GATE) / np.sqrt(HIDDEN)
    value = 0.1 * rng.standard_normal(HIDDEN + INPUTS + 1)
    return np.concatenate([rows.ravel(), gate, value])


def sharpened(weights: Floats, factor: float) -> Floats:
    """The weights with both breakaway edges ``factor`` times as steep, at the same place."""
    sharp = weights.copy()
    sharp[:, : 2 * (INPUTS + 1)] *= factor
    return sharp


PERCENT_PER_AMPLITUDE = 25.0  # the records as percent of span, for the product's own fit
EPS = 5e-5  # of the saturated regressors, when training ends
# Widths of the gate's edges that seeds start with in turn, in amplitudes: a wider one can correct a
# larger error of the fitted S and J, a narrower one affects fewer samples.
START_WIDTHS = (3e-3, 1e-2, 1e-3)
START_SPREAD = 1e-3  # relative, of the seeds' S and J about the fitted ones
_FITTED_SEED, _RANDOM_SEED = 4, 5


@dataclass(frozen=True, kw_only=True)
class GatedStage:
    """A stage at ``eps``, before which the gate's edges are made ``sharper`` so many times."""

    stage: TrainingStage
    eps: float = EPS
    sharper: float = 1.0


# A wide edge has a gradient from the samples on either side and moves between them; then it is
# sharpened.
FROM_FITTED = (
    GatedStage(stage=TrainingStage(horizon=1, steps=20)),
    *4 * (GatedStage(stage=TrainingStage(horizon=1, steps=12), sharper=3.0),),
    GatedStage(stage=TrainingStage(horizon=20, steps=8)),
    GatedStage(stage=TrainingStage(horizon=300, steps=8)),
)
# Sharp regressors have no gradient, so random weights begin with soft ones.
FROM_RANDOM = (
    *(
        GatedStage(stage=TrainingStage(horizon=1, steps=10), eps=eps)
        for eps in (0.05, 0.01, 0.002, 5e-4)
    ),
    GatedStage(stage=TrainingStage(horizon=1, steps=6)),
    GatedStage(stage=TrainingStage(horizon=20, steps=6)),
    GatedStage(stage=TrainingStage(horizon=300, steps=6)),
)


@dataclass(frozen=True, kw_only=True)
class Trained:
    """``step`` with (seeds, 35) weights before (``starts``) and after training (``weights``)."""

    step: GatedStep
    starts: Floats
    weights: Floats


def fit_S_J(u: Floats, y: Floats) -> tuple[float, float]:
    """S and J of a record in amplitudes, from ``fit_stickslip`` as for any valve."""
    signals = {
        role: Signal.good(50.0 + PERCENT_PER_AMPLITUDE * values, role.value)
        for role, values in ((Role.OP, u), (Role.MV, y))
    }
    fit = fit_stickslip(Recording(valve="paper", signals=signals, interval_s=INTERVAL_S))
    return fit.S / PERCENT_PER_AMPLITUDE, fit.J / PERCENT_PER_AMPLITUDE


def train_from_fitted(u: Floats, y: Floats, fitted: tuple[float, float], seeds: int) -> Trained:
    """Grey-box: the first seed starts from the fitted S and J, the others from some near them."""
    se = error_scale(u, y)
    starts = []
    for seed in range(seeds):
        draw = np.random.default_rng([_FITTED_SEED, seed]).standard_normal(2)
        S, J = np.array(fitted) * (1.0 + (START_SPREAD * draw if seed else 0.0))
        starts.append(start_from(S, J, se, START_WIDTHS[seed % len(START_WIDTHS)]))
    return _trained(u, y, np.stack(starts), FROM_FITTED)


def train_from_random(u: Floats, y: Floats, seeds: int) -> Trained:
    """Training from random weights, without knowledge of S and J."""
    rngs = (np.random.default_rng([_RANDOM_SEED, seed]) for seed in range(seeds))
    return _trained(u, y, np.stack([random_start(rng) for rng in rngs]), FROM_RANDOM)


def _trained(u: Floats, y: Floats, starts: Floats, stages: Sequence[GatedStage]) -> Trained:
    """Of each seed the weights, after any stage at ``EPS``, with the lowest error of the free run
    over the training record."""
    se = error_scale(u, y)
    final = GatedStep(se=se, eps=EPS)
    weights = best = starts
    for stage in stages:
        step = GatedStep(se=se, eps=stage.eps)
        weights = fit_stage(step, sharpened(weights, stage.sharper), u, y, stage.stage)
        best = keep_best(final, best, weights, u, y)
    return Trained(step=final, starts=starts, weights=best)
