"""The compiled normal matrix, against the one that torch builds from a whole Jacobian."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.narx import kernel, sensitivities
from stemwatch.models.narx.batch import blocks, bounds
from stemwatch.models.narx.example import NarxExample, NarxSettings
from stemwatch.models.narx.network import EDGE
from stemwatch.models.narx.normal import normal_of
from stemwatch.models.narx.plan import CODES, Step, plan_run, segments
from stemwatch.models.narx.prepared import Prepared, prepare
from stemwatch.models.narx.starts import random_starts
from stemwatch.models.recording import Floats

SIZE = 42  # weights and the residual


def ready(seed: int = 1, samples: int = 900) -> Prepared:
    """A stem that follows a slow command late and noisily, with a hole."""
    make = np.random.default_rng(seed)
    op = 50.0 + np.cumsum(make.normal(size=samples)) * 0.3
    mv = np.concatenate([op[:3], op[:-3]]) + 0.05 * make.normal(size=samples)
    usable = np.ones(samples, dtype=bool)
    usable[200:205] = False
    found = prepare(
        NarxExample(valve="V", op=op, mv=mv, usable=usable, train_until=600, interval_s=1.0),
        NarxSettings(),
    )
    assert isinstance(found, Prepared), found
    return found


def compiled(valve: Prepared, weights: Floats, horizon: int, most: float = np.inf) -> Floats | None:
    """The kernel's normal matrix, or none where it gave up."""
    out, signals = np.zeros((SIZE, SIZE)), valve.signals
    whole = kernel.normal_matrix(
        weights,
        5,
        signals.level,
        signals.move,
        signals.position,
        segments(valve.trained, horizon),
        valve.limits,
        valve.ratio,
        EDGE,
        sensitivities.LIMIT,
        most,
        out,
    )
    return out if whole else None


def by_torch(valves: list[Prepared], flat: torch.Tensor, horizon: int) -> Floats:
    """The same of a padded batch, as on a device that is no CPU."""
    pieces, limits = blocks(valves, horizon, 1, "cpu"), bounds(valves, 1, "cpu")
    split = sensitivities.Weights.split(flat, 5)
    return sensitivities.normal_matrix(pieces, split, limits).numpy()


@pytest.mark.parametrize("horizon", [1, 20, 300])
@pytest.mark.parametrize("scale", [1.0, 8.0], ids=["gentle", "wild, so that clamps act"])
def test_the_kernel_and_torch_build_the_same_matrix(horizon: int, scale: float) -> None:
    """One network at a time without padding, or all of them padded: the same numbers.

    To 1e-8 only, because a wild run carries a difference of the last digit far.
    """
    valves = [ready(1), ready(2, 700)]
    flat = scale * random_starts(NarxSettings(), 2)
    expected = by_torch(valves, torch.from_numpy(flat), horizon)
    for valve, weights, matrix in zip(valves, flat, expected, strict=True):
        found = compiled(valve, weights, horizon)
        assert found is not None
        np.testing.assert_allclose(found, matrix, rtol=0, atol=1e-8 * np.abs(matrix).max())


def test_it_gives_up_exactly_where_the_error_allowed_is_passed() -> None:
    """A bound of r'r itself is not passed; the next smaller number is."""
    valve, weights = ready(), random_starts(NarxSettings(), 1)[0]
    whole = compiled(valve, weights, 20)
    assert whole is not None
    squares = 0.0
    for residual in _residuals(valve, weights, 20):
        squares += residual * residual
    assert squares == pytest.approx(whole[-1, -1], rel=1e-12)
    assert compiled(valve, weights, 20, most=squares * (1 + 1e-12)) is not None
    assert compiled(valve, weights, 20, most=squares * (1 - 1e-12)) is None
    assert compiled(valve, np.full(41, np.nan), 20) is None


def _residuals(valve: Prepared, weights: Floats, horizon: int) -> Floats:
    """The same network's free runs against the measurement, sample by sample."""
    plan, signals = plan_run(valve.trained, horizon), valve.signals
    out = np.full((1, plan.size), np.nan)
    kernel.free_run(
        weights[None],
        5,
        signals.level,
        signals.move,
        signals.position,
        plan,
        CODES,
        valve.limits,
        valve.ratio,
        EDGE,
        out,
    )
    return np.asarray((out[0] - signals.position)[plan >= Step.RUN])


def test_a_network_that_is_done_is_not_worked_on() -> None:
    """Where no error is small enough the matrix is not built, and its error counts as infinite."""
    flat = torch.from_numpy(random_starts(NarxSettings(), 2))
    normal, samples = normal_of([ready()], 5, 20, 2, "cpu")
    matrices = normal(flat, torch.tensor([torch.inf, -torch.inf], dtype=torch.float64))
    assert bool(torch.isfinite(matrices[0]).all())
    assert matrices[1, -1, -1] == torch.inf
    assert not matrices[1, :-1].any()
    assert samples.tolist() == [float(segments(ready().trained, 20)[1].sum())] * 2


@settings(deadline=None)
@given(st.floats(min_value=-1e308, max_value=1e308))
def test_the_quick_tanh_is_a_tanh(x: float) -> None:
    """Within 4e-16 everywhere, also where the exponential overflows."""
    assert abs(kernel._tanh(x) - np.tanh(x)) <= 4e-16
