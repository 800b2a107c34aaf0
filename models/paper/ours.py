"""Our network trained: from S and J as the product fits them, or from random weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.paper.cases import INTERVAL_S
from stemwatch.models.paper.fitting import Stage, fit_stage, keep_best
from stemwatch.models.paper.gated import (
    GatedStep,
    error_scale,
    random_start,
    sharpened,
    start_from,
)
from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.stickslip.fit import fit_stickslip

PERCENT_PER_AMPLITUDE = 25.0  # the records as percent of span, for the product's own fit
EPS = 5e-5  # of the saturated regressors, when training ends
# Widths of the gate's edges that seeds start with in turn, amplitudes: a wider one mends a larger
# error of the fitted S and J, a narrower one is disturbed by fewer samples.
START_WIDTHS = (3e-3, 1e-2, 1e-3)
START_SPREAD = 1e-3  # relative, of the seeds' S and J about the fitted ones
_FITTED_SEED, _RANDOM_SEED = 4, 5


@dataclass(frozen=True, kw_only=True)
class GatedStage:
    """A stage at ``eps``, before which the gate's edges are made ``sharper`` so many times."""

    stage: Stage
    eps: float = EPS
    sharper: float = 1.0


# A wide edge sees the samples on either side of it and moves between them; then it is sharpened.
FROM_FITTED = (
    GatedStage(stage=Stage(horizon=1, steps=20)),
    *4 * (GatedStage(stage=Stage(horizon=1, steps=12), sharper=3.0),),
    GatedStage(stage=Stage(horizon=20, steps=8)),
    GatedStage(stage=Stage(horizon=300, steps=8)),
)
# Sharp regressors have no gradient, so random weights begin with soft ones.
FROM_RANDOM = (
    *(GatedStage(stage=Stage(horizon=1, steps=10), eps=eps) for eps in (0.05, 0.01, 0.002, 5e-4)),
    GatedStage(stage=Stage(horizon=1, steps=6)),
    GatedStage(stage=Stage(horizon=20, steps=6)),
    GatedStage(stage=Stage(horizon=300, steps=6)),
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
    """Grey-box: every seed starts from S and J near the fitted ones, the first from these."""
    se = error_scale(u, y)
    starts = []
    for seed in range(seeds):
        draw = np.random.default_rng([_FITTED_SEED, seed]).standard_normal(2)
        S, J = np.array(fitted) * (1.0 + (START_SPREAD * draw if seed else 0.0))
        starts.append(start_from(S, J, se, START_WIDTHS[seed % len(START_WIDTHS)]))
    return _trained(u, y, np.stack(starts), FROM_FITTED)


def train_from_random(u: Floats, y: Floats, seeds: int) -> Trained:
    """Nothing known of S and J."""
    rngs = (np.random.default_rng([_RANDOM_SEED, seed]) for seed in range(seeds))
    return _trained(u, y, np.stack([random_start(rng) for rng in rngs]), FROM_RANDOM)


def _trained(u: Floats, y: Floats, starts: Floats, stages: Sequence[GatedStage]) -> Trained:
    """Of each seed the weights, after any stage at ``EPS``, with the lowest error of the free run
    over the training record."""
    se = error_scale(u, y)
    final = GatedStep(se=se, eps=EPS)
    weights = best = starts
    for one in stages:
        step = GatedStep(se=se, eps=one.eps)
        weights = fit_stage(step, sharpened(weights, one.sharper), u, y, one.stage)
        best = keep_best(final, best, weights, u, y)
    return Trained(step=final, starts=starts, weights=best)
