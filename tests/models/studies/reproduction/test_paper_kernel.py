"""The compiled three-layer networks, against their own equations in torch."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from stemwatch.models.recording import Floats
from stemwatch.models.studies.reproduction.fitting import Segments, normal_matrix
from stemwatch.models.studies.reproduction.layers import (
    FEEDFORWARD,
    FEEDFORWARD_INPUTS,
    NARX,
    NARX_INPUTS,
    ThreeLayers,
)
from stemwatch.models.studies.reproduction.network_step import run_free
from stemwatch.models.verdict import Shape

# Compiling the kernels of a study that no plant runs takes longer than all else here.
pytestmark = pytest.mark.long

KINDS = [
    (table[shape], inputs)
    for shape in Shape
    if shape in NARX
    for table, inputs in ((NARX, NARX_INPUTS), (FEEDFORWARD, FEEDFORWARD_INPUTS))
]
# Of the pairs of a NARX and a feedforward network the first and the last are in the short run.
every = pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=[pytest.mark.long] if 2 <= place < len(KINDS) - 2 else [])
        for place, kind in enumerate(KINDS)
    ],
    ids=lambda k: f"{len(k[1])} in, {'-'.join(k[0])}",
)


def network(kind: tuple) -> tuple[ThreeLayers, Floats]:  # type: ignore[type-arg]
    """A step and two sets of gentle random weights."""
    step = ThreeLayers(transfers=kind[0], inputs=kind[1], reach=1.3)
    starts = [0.5 * step.random_start(np.random.default_rng([7, k])) for k in range(2)]
    return step, np.stack(starts)


def plain(step: ThreeLayers):  # type: ignore[no-untyped-def]
    """The same equations without the kernels, so that torch runs and differentiates them."""
    return lambda weights, lags: step(weights, lags)


def record(horizon: int) -> Segments:
    """Runs of two unlike sines."""
    t = np.arange(120)
    u, y = np.sin(t / 9.0), 0.8 * np.sin(t / 9.0 - 0.4)
    return Segments.cut(u, y, horizon)


@every
def test_a_compiled_run_is_the_equations_run(kind: tuple) -> None:  # type: ignore[type-arg]
    """Sample by sample the same as with torch, also where the run is held."""
    step, weights = network(kind)
    cut = record(50)
    for scale in (1.0, 30.0):
        flat = torch.from_numpy(scale * weights)
        expected = run_free(plain(step), flat, cut.u, cut.y)
        torch.testing.assert_close(run_free(step, flat, cut.u, cut.y), expected, rtol=0, atol=1e-9)


@every
@pytest.mark.parametrize("horizon", [1, 15])
def test_compiled_derivatives_are_those_of_the_equations(kind: tuple, horizon: int) -> None:  # type: ignore[type-arg]
    """The normal matrix, carried through the run, equals the one that torch differentiates."""
    step, weights = network(kind)
    flat, cut = torch.from_numpy(weights), record(horizon)
    expected = normal_matrix(plain(step), flat, cut)
    matrix = normal_matrix(step, flat, cut)
    assert float(expected.abs().max()) > 0.0
    torch.testing.assert_close(matrix, expected, rtol=0, atol=1e-9 * float(expected.abs().max()))
