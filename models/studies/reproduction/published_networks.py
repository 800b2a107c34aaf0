"""The paper's networks, trained on its sine as well as we can."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.studies.reproduction.fitting import TrainingStage, fit_stage, keep_best
from stemwatch.models.studies.reproduction.layers import (
    FEEDFORWARD,
    FEEDFORWARD_INPUTS,
    NARX,
    NARX_INPUTS,
    ThreeLayers,
)
from stemwatch.models.verdict import Shape

_SEED = 3
# The paper trains series-parallel with static back-propagation. We go on to free runs of a tenth
# of a period and of a whole one, which makes its NARX several times better and keeps more seeds
# from diverging.
_ONE_STEP = TrainingStage(horizon=1, steps=60)
_FREE_RUNS = (TrainingStage(horizon=15, steps=25), TrainingStage(horizon=150, steps=25))


def train_feedforward(shape: Shape, u: Floats, y: Floats, seeds: int) -> tuple[ThreeLayers, Floats]:
    """The static network of Table 1, and (seeds, P) weights."""
    step = ThreeLayers(transfers=FEEDFORWARD[shape], inputs=FEEDFORWARD_INPUTS, reach=_reach(u, y))
    return step, fit_stage(step, _starts(step, seeds), u, y, _ONE_STEP)


def train_narx(shape: Shape, u: Floats, y: Floats, seeds: int) -> tuple[ThreeLayers, Floats]:
    """The recurrent network of Table 1, and (seeds, P) weights: of each seed those, after any
    stage, with the lowest error of the free run over the sine."""
    step = ThreeLayers(transfers=NARX[shape], inputs=NARX_INPUTS, reach=_reach(u, y))
    weights = best = fit_stage(step, _starts(step, seeds), u, y, _ONE_STEP)
    for stage in _FREE_RUNS:
        weights = fit_stage(step, weights, u, y, stage)
        best = keep_best(step, best, weights, u, y)
    return step, best


def _starts(step: ThreeLayers, seeds: int) -> Floats:
    rngs = (np.random.default_rng([_SEED, seed]) for seed in range(seeds))
    return np.stack([step.random_start(rng) for rng in rngs])


def _reach(u: Floats, y: Floats) -> float:
    return float(max(np.abs(u).max(), np.abs(y).max()))
