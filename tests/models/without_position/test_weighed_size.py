"""S by the network and by how well the element predicts with it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.studies.loops.draws import draw_loop
from stemwatch.models.without_position.features import Evidence, evidence
from stemwatch.models.without_position.weighed_size import REACH, WEIGHT, weighed_log_S


def with_gains(of_share) -> Evidence:
    """Evidence whose element gains ``of_share`` of each ln(S/amplitude), by both models at both
    scales."""
    loop = draw_loop(77, 0)
    found = evidence(loop.op, loop.pv)
    curve = of_share(np.log(found.sizes / found.amplitude))
    scale = replace(found.coarse, curve=curve, curve_of_both=curve)
    return replace(found, coarse=scale, fine=scale)


@pytest.mark.parametrize("log_S", [-0.8, -0.3])
def test_without_a_preference_it_is_the_networks(log_S) -> None:
    """The element predicts alike with every S."""
    assert weighed_log_S(with_gains(np.zeros_like), log_S, 0.2) == pytest.approx(log_S)


def test_a_gain_moves_it_by_its_slope_and_the_spread() -> None:
    """With a gain that rises by g for each unit, a Gaussian of spread d moves by WEIGHT g d^2,
    and never farther than the reach."""
    gentle, steep = (with_gains(lambda log_S, g=g: g * log_S) for g in (0.5, 500.0))
    moved = weighed_log_S(gentle, -0.5, 0.1) + 0.5
    assert moved == pytest.approx(WEIGHT * 0.5 * 0.1**2, rel=0.02)
    assert weighed_log_S(steep, -0.5, 0.5) + 0.5 == pytest.approx(REACH, abs=0.02)


def test_beyond_what_was_tried_nothing_is_gained() -> None:
    """An S larger than any that was tried is the network's."""
    beyond = weighed_log_S(with_gains(np.exp), 3.0, 0.2)
    assert beyond == pytest.approx(3.0)
