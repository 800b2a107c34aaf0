"""The plants that judge groups of oscillating loops: what is true of them is known."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.studies.interacting_loops.draws import draw_plant, run_drawn
from stemwatch.models.studies.interacting_loops.score_plant import (
    adjusted_rand_index,
    plant_of,
    score_plant,
)


def test_partitions_agree_whatever_their_names() -> None:
    """1 for the same, 0 for one that says nothing; a published example."""
    assert adjusted_rand_index([0, 0, 1, 1], [5, 5, -1, -1]) == 1.0
    assert adjusted_rand_index([0, 0, 1, 1], [0, 0, 0, 0]) == 0.0
    assert adjusted_rand_index([0, 0, 1, 1], [0, 0, 1, 2]) == pytest.approx(0.5714, abs=1e-4)


def test_a_plant_is_the_same_by_seed_and_number() -> None:
    """Whichever others are made."""
    item, other = plant_of(5151, 3), plant_of(5151, 3)
    assert np.array_equal(item.pv, other.pv)
    assert item.label == other.label
    assert item.pv.shape == item.op.shape == item.sp.shape
    assert 10 <= len(item.units) <= 40


def test_a_plant_without_sources_has_no_truth_to_find() -> None:
    """And comes to rest: its loops stay within a few percent of their set points."""
    plant = run_drawn(draw_plant(np.random.default_rng(6161), sources=0))
    assert set(plant.label) == {-1}
    assert plant.shares.size == 0
    assert np.abs(plant.pv - plant.sp).mean() < 3.0


def test_a_source_moves_its_own_loop() -> None:
    """The share of a sticking or tight loop's own variance that it makes; judged all the same."""
    rng = np.random.default_rng(7171)
    plants = [run_drawn(draw_plant(rng, sources=1)) for _ in range(4)]
    own = [p.shares[0, p.sources[0].loop] for p in plants if p.sources[0].loop >= 0]
    assert max(own) > 0.5
    judged = score_plant(plants[0])
    assert judged.loops == len(plants[0].units)
    assert judged.quiet == (set(plants[0].label) == {-1})
