"""A spring with inner friction, by hand and by its rules."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch.stem_model.inner_friction import (
    REACHES,
    Anchors,
    dragged,
    first_anchor,
    held_back,
    way_through,
)
from stemwatch.models.recording import Floats

WAY = 8.0


def moved_to(x: float, anchors: Anchors) -> Anchors:
    """Where the anchors are with the stem at ``x``."""
    short, middle, long = (
        dragged(anchor, x, WAY, reach) for anchor, reach in zip(anchors, REACHES, strict=True)
    )
    return short, middle, long


def along(places: list[float]) -> Floats:
    """What is held back at each of some places, from rest at the first."""
    anchors, shares = (places[0], places[0], places[0]), []
    for x in places:
        anchors = moved_to(x, anchors)
        shares.append(held_back(anchors, x, WAY))
    return np.array(shares)


def test_its_elements_slip_one_after_the_other() -> None:
    """Risen from rest by a quarter, a half and the whole of the way, then twice as far back."""
    shares = along([50.0, 52.0, 54.0, 58.0, 70.0, 66.0, 54.0])
    np.testing.assert_allclose(
        shares, [0.0, 1.75 / 3.0, 2.5 / 3.0, 1.0, 1.0, (-1.0 + 0.0 + 0.5) / 3.0, -1.0]
    )


def test_a_small_loop_closes() -> None:
    """After a turn to and fro, inside of a larger one, all is as if there had been none."""
    straight = along([40.0, 60.0, 57.0, 45.0])
    looped = along([40.0, 60.0, 57.0, 58.5, 57.0, 45.0])
    np.testing.assert_allclose(looped[[2, 4, 5]], straight[[2, 2, 3]], atol=1e-12)


def test_noise_within_its_reach_leaves_no_trace() -> None:
    """A stem that trembles by a tenth of the shortest reach for long holds what it held."""
    rng = np.random.default_rng(1)
    tremble = 55.0 + 0.2 * rng.uniform(-1.0, 1.0, 2000)
    shares = along([40.0, 60.0, 55.0, *tremble, 55.0])
    assert shares[-1] == pytest.approx(shares[2], abs=0.1)


def test_a_record_begins_with_the_share_of_its_force() -> None:
    """Anchored so that each element holds back the share that it is told."""
    short, middle, long = (first_anchor(50.0, WAY, reach, -0.6) for reach in REACHES)
    assert held_back((short, middle, long), 50.0, WAY) == pytest.approx(-0.6)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("gap", [0.3, 2.0, 5.0, 15.0])
@pytest.mark.parametrize("hysteresis", [0.5, 4.0])
def test_it_slides_until_spring_and_friction_close_the_gap(side, gap, hysteresis) -> None:
    """Found again by what is held back before and after the way."""
    anchors, x = (50.5, 51.0, 47.0), 51.5
    u = way_through(anchors, x, side, gap, hysteresis, WAY)
    there = x + side * u
    more = side * (held_back(moved_to(there, anchors), there, WAY) - held_back(anchors, x, WAY))
    assert u + hysteresis * more == pytest.approx(gap)
