"""Our network with its weights set by hand is the stick-slip element."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.recording import Floats
from stemwatch.models.studies.reproduction.cases import CASES, PaperCase
from stemwatch.models.studies.reproduction.network_step import simulate
from stemwatch.models.studies.reproduction.our_network import (
    GatedStep,
    error_scale,
    random_start,
    sharpened,
    start_from,
)
from stemwatch.models.studies.reproduction.signals import FAMILIES, unseen
from stemwatch.models.studies.reproduction.study import rmse


def follow(case: PaperCase, inputs: list[Floats], S: float, J: float) -> Floats:
    """RMSE of the network set from S and J on inputs of one case."""
    truths = [case.respond(u) for u in inputs]
    se = error_scale(inputs[0], truths[0])
    weights = start_from(S, J, se, width=1e-9)[None]
    runs = simulate(GatedStep(se=se, eps=1e-7), weights, inputs, truths)
    return rmse(runs[0], np.stack(truths))


def test_it_has_few_weights() -> None:
    """35, whichever way they are begun."""
    assert start_from(0.5, 0.2, 0.3, 1e-3).shape == (35,)
    assert random_start(np.random.default_rng(1)).shape == (35,)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=[pytest.mark.long] if k else []) for k, case in enumerate(CASES)],
    ids=lambda case: case.shape.value,
)
def test_set_from_the_true_S_and_J_it_is_the_element(case: PaperCase, family: str) -> None:
    """On any input the free run is the element's, so the form can hold all four shapes."""
    assert follow(case, unseen(family, 3), case.S, case.J).max() < 1e-6


@pytest.mark.long
@given(S=st.floats(0.05, 1.0), ratio=st.floats(0.0, 1.8), seed=st.integers(0, 999))
@settings(max_examples=15, deadline=None)
def test_it_is_the_element_for_any_S_and_J(S: float, ratio: float, seed: int) -> None:
    """Also where J is far above S, or both are small."""
    base = CASES[0]
    case = PaperCase(
        shape=base.shape, S=S, J=S * ratio, feedforward=base.feedforward, narx=base.narx
    )
    u = FAMILIES["sums of sines"](np.random.default_rng([9, seed]))[:400]
    assert follow(case, [u], S, S * ratio).max() < 1e-5


def test_a_wrong_S_is_seen_in_the_free_run() -> None:
    """With S a tenth too large slips come late: the run is not the element's by construction."""
    case = CASES[1]
    assert follow(case, unseen("other sines", 2), 1.1 * case.S, case.J).min() > 0.01


def test_sharpening_leaves_the_edges_where_they_are() -> None:
    """Both breakaway rows grow alike, so that e/se = fs still lies on them; nothing else moves."""
    weights = start_from(0.6, 0.3, 0.25, 1e-3)[None]
    sharper = sharpened(weights, 4.0)
    edges = [-rows[0, [3, 7]] / rows[0, [0, 4]] * 0.25 for rows in (weights, sharper)]
    assert edges[0] == pytest.approx([0.45, -0.45])
    assert edges[1] == pytest.approx(edges[0])
    assert sharper[0, 0] == pytest.approx(4.0 * weights[0, 0])
    assert np.array_equal(sharper[:, 8:], weights[:, 8:])
