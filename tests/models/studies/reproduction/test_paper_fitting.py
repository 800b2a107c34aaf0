"""Levenberg-Marquardt on free runs: derivatives, convergence, and what is kept."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from stemwatch.models.recording import Floats
from stemwatch.models.studies.reproduction.fitting import (
    Segments,
    TrainingStage,
    fit_stage,
    keep_best,
    normal_matrix,
    run_errors,
)
from stemwatch.models.studies.reproduction.layers import NARX, NARX_INPUTS, ThreeLayers
from stemwatch.models.studies.reproduction.network_step import LIMIT, run_free, simulate
from stemwatch.models.verdict import Shape

TANGENT = ThreeLayers(
    transfers=NARX[Shape.OVERSHOOT], inputs=NARX_INPUTS, reach=1.0, sizes=(3, 3, 1)
)
LINEAR = ThreeLayers(
    transfers=NARX[Shape.NO_OFFSET], inputs=NARX_INPUTS, reach=1.0, sizes=(1, 1, 1)
)


def signals(n: int) -> tuple[Floats, Floats]:
    """A command, and a second-order linear answer to it."""
    rng = np.random.default_rng(5)
    u, y = rng.uniform(-0.5, 0.5, n), np.zeros(n)
    for t in range(2, n):
        y[t] = 0.6 * y[t - 1] - 0.2 * y[t - 2] + 0.5 * u[t - 1] + 0.1 * u[t - 2]
    return u, y


@pytest.mark.long
@pytest.mark.parametrize("horizon", [1, 12])
def test_the_gradient_is_that_of_the_runs_error(horizon: int) -> None:
    """J'r, carried forward through the run, is the slope of half the summed square."""
    u, y = signals(62)
    cut = Segments.cut(u, y, horizon)
    weights = torch.from_numpy(0.4 * TANGENT.random_start(np.random.default_rng(2))[None])
    gradient = normal_matrix(TANGENT, weights, cut)[0, :-1, -1]

    def half_square(flat: torch.Tensor) -> float:
        runs = run_free(TANGENT, flat, cut.u, cut.y)[0]
        return 0.5 * float((runs[2:] - cut.y[2:]).square().sum())

    for at in (0, 7, 15, weights.shape[1] - 1):
        nudge = torch.zeros_like(weights)
        nudge[0, at] = 1e-5
        slope = (half_square(weights + nudge) - half_square(weights - nudge)) / 2e-5
        assert float(gradient[at]) == pytest.approx(slope, rel=1e-5, abs=1e-8)


@pytest.mark.long
def test_a_linear_valve_is_found_by_the_linear_network() -> None:
    """From two random starts, series-parallel and then on free runs, to the last digits."""
    u, y = signals(300)
    weights = np.stack([LINEAR.random_start(np.random.default_rng(s)) for s in (1, 2)])
    for stage in (TrainingStage(horizon=1, steps=40), TrainingStage(horizon=30, steps=20)):
        weights = fit_stage(LINEAR, weights, u, y, stage)
    assert run_errors(LINEAR, weights, u, y).max() < 1e-4


def test_training_never_makes_the_error_it_minimises_larger() -> None:
    """A step that does not lower the loss is not taken."""
    u, y = signals(200)
    start = TANGENT.random_start(np.random.default_rng(3))[None]
    trained = fit_stage(TANGENT, start, u, y, TrainingStage(horizon=1, steps=5))
    cut = Segments.cut(u, y, 1)
    losses = [
        float(normal_matrix(TANGENT, torch.from_numpy(w), cut)[0, -1, -1]) for w in (start, trained)
    ]
    assert losses[1] < losses[0]


def test_the_better_free_run_is_kept_network_by_network() -> None:
    """The first is better before, the second after: one of each is kept."""
    u, y = signals(200)
    good = fit_stage(
        LINEAR,
        LINEAR.random_start(np.random.default_rng(1))[None],
        u,
        y,
        TrainingStage(horizon=1, steps=40),
    )
    bad = good + 0.3
    before, after = np.concatenate([good, bad]), np.concatenate([bad, good])
    assert np.array_equal(keep_best(LINEAR, before, after, u, y), np.concatenate([good, good]))


def test_a_run_that_diverges_is_held_at_the_limit() -> None:
    """Weights that multiply y by 100 give a finite error, not infinity."""
    u, y = signals(50)
    weights = np.full((1, LINEAR.random_start(np.random.default_rng(0)).size), 5.0)
    run = simulate(LINEAR, weights, [u], [y])[0, 0]
    assert np.isfinite(run).all()
    assert np.abs(run[2:]).max() == LIMIT


def test_a_run_starts_from_the_first_two_samples() -> None:
    """They are returned as they are; nothing after them is looked at."""
    u, y = signals(50)
    weights = LINEAR.random_start(np.random.default_rng(0))[None]
    run = simulate(LINEAR, weights, [u], [y])[0, 0]
    later = np.concatenate([y[:2], np.full(48, np.nan)])
    assert np.array_equal(run[:2], y[:2])
    assert np.array_equal(simulate(LINEAR, weights, [u], [later])[0, 0], run)
