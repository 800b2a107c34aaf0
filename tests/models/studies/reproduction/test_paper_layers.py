"""The paper's networks: Table 1, layer by layer."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from stemwatch.models.studies.reproduction.layers import (
    FEEDFORWARD,
    FEEDFORWARD_INPUTS,
    NARX,
    NARX_INPUTS,
    SIZES,
    ThreeLayers,
)
from stemwatch.models.studies.reproduction.network_step import LAGS
from stemwatch.models.verdict import Shape

# Copied from the paper's Table 1, column by column: layers 1, 2 and 3.
TABLE_1 = {
    "feedforward": {
        Shape.DEADBAND: "log sigmoid, tangent sigmoid, linear",
        Shape.UNDERSHOOT: "log sigmoid, linear, log sigmoid",
        Shape.NO_OFFSET: "linear, linear, log sigmoid",
        Shape.OVERSHOOT: "linear, linear, log sigmoid",
    },
    "narx": {
        Shape.DEADBAND: "linear, log sigmoid, linear",
        Shape.UNDERSHOOT: "log sigmoid, linear, log sigmoid",
        Shape.NO_OFFSET: "linear, linear, linear",
        Shape.OVERSHOOT: "linear, tangent sigmoid, linear",
    },
}
FUNCTION = {
    "log sigmoid": lambda x: 1.0 / (1.0 + np.exp(-x)),
    "tangent sigmoid": np.tanh,
    "linear": lambda x: x,
}


@pytest.mark.parametrize("shape", Shape)
def test_transfer_functions_are_those_of_table_1(shape: Shape) -> None:
    """Each layer of each network has the transfer function the paper gives it."""
    results = {"feedforward": FEEDFORWARD[shape], "narx": NARX[shape]}
    assert {name: ", ".join(layers) for name, layers in results.items()} == {
        name: column[shape] for name, column in TABLE_1.items()
    }


def test_each_network_has_three_layers_and_the_lags_that_are_stated() -> None:
    """10, 10 and 1 units; u(t) alone for feedforward, two lags of each for NARX, no u(t)."""
    still = NARX[Shape.DEADBAND]
    static = ThreeLayers(transfers=still, inputs=FEEDFORWARD_INPUTS, reach=1.0)
    recurrent = ThreeLayers(transfers=still, inputs=NARX_INPUTS, reach=1.0)
    assert SIZES == (10, 10, 1)
    assert static.shapes == ((10, 2), (10, 11), (1, 11))
    assert recurrent.shapes == ((10, 5), (10, 11), (1, 11))
    assert [LAGS[feedforward_input] for feedforward_input in FEEDFORWARD_INPUTS] == ["u(t)"]
    assert [LAGS[narx_input] for narx_input in NARX_INPUTS] == [
        "u(t-1)",
        "u(t-2)",
        "y(t-1)",
        "y(t-2)",
    ]


@pytest.mark.parametrize("shape", Shape)
def test_a_network_computes_its_three_layers(shape: Shape) -> None:
    """The answer is W3 f2(W2 f1(W1 x + b1) + b2) + b3 through f3, laid on the target's scale."""
    step = ThreeLayers(transfers=NARX[shape], inputs=NARX_INPUTS, reach=1.25)
    rng = np.random.default_rng(7)
    weights, lags = step.random_start(rng), rng.uniform(-1.0, 1.0, len(LAGS))
    names = TABLE_1["narx"][shape].split(", ")
    signal, rest = lags[list(NARX_INPUTS)] / 1.25, weights
    for (units, wide), name in zip(((10, 5), (10, 11), (1, 11)), names, strict=True):
        matrix, rest = rest[: units * wide].reshape(units, wide), rest[units * wide :]
        signal = FUNCTION[name](matrix[:, :-1] @ signal + matrix[:, -1])
    centre, share = (0.5, 0.4) if names[-1] == "log sigmoid" else (0.0, 0.8)
    answer = step(torch.from_numpy(weights[None]), torch.from_numpy(lags[None, None]))
    assert rest.size == 0
    assert answer.item() == pytest.approx(1.25 * (signal[0] - centre) / share, abs=1e-12)
