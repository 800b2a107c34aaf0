"""The simulated plants for testing groups of oscillating loops, whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.oscillation_groups.limits import WEIGHTS
from stemwatch.models.oscillation_groups.sources import MemberEvidence
from stemwatch.models.studies.interacting_loops.draws import _labels, draw_plant, run_drawn
from stemwatch.models.studies.interacting_loops.fitting import (
    PlantEvidence,
    fit_limits,
    fit_sources,
    limit_of,
    plant_evidence,
)
from stemwatch.models.studies.interacting_loops.score_plant import (
    adjusted_rand_index,
    plant_of,
    score_plant,
)


def test_partitions_agree_whatever_their_names() -> None:
    """The index is 1 for equal partitions and 0 for an uninformative one; and a published
    example.
    """
    assert adjusted_rand_index([0, 0, 1, 1], [5, 5, -1, -1]) == 1.0
    assert adjusted_rand_index([0, 0, 1, 1], [0, 0, 0, 0]) == 0.0
    assert adjusted_rand_index([0, 0, 1, 1], [0, 0, 1, 2]) == pytest.approx(0.5714, abs=1e-4)


def test_a_plant_is_the_same_by_seed_and_number() -> None:
    """It does not depend on which others are drawn."""
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


def test_a_loop_of_a_source_that_moves_no_other_belongs_to_its_next_source() -> None:
    """Its label is the next of its sources."""
    shares = np.array([[0.9, 0.0, 0.05], [0.3, 0.4, 0.2]])
    assert _labels(shares) == (1, 1, 1)
    assert _labels(shares[:1]) == (-1, -1, -1)
    assert _labels(np.zeros((0, 3))) == (-1, -1, -1)


def shown(rng: np.random.Generator, *, quiet: bool) -> PlantEvidence:
    """A plant whose candidates are groups where their shares are large, and whose source has most
    of the harmonics and acts on the others."""
    true = np.zeros(6, dtype=bool) if quiet else np.arange(6) < 4
    rows = np.column_stack(
        [np.ones(6), np.where(true, -0.5, -1.8) + 0.3 * rng.normal(size=6), rng.normal(size=(6, 2))]
    )
    values = rng.normal(size=(3, 8)) * 0.3
    values[1, 3] += 2.0
    values[:, 7] = (0.0, 1.0, 0.0)
    evidence = MemberEvidence(members=(4, 5, 8), values=values, connected=True)
    groups = () if quiet else ((evidence, 5),)
    return PlantEvidence(quiet=quiet, candidates=rows, alike=true * 0.9, groups=groups)


def test_limits_and_weights_come_from_plants_whose_truth_is_known() -> None:
    """What tells groups from chance has the weight; fewer than one quiet plant of twenty passes the
    limit, since they are only some of all."""
    rng = np.random.default_rng(6161)
    plants = [shown(rng, quiet=k % 2 == 0) for k in range(240)]
    quiet = [plant for plant in plants if plant.quiet]
    limits, weights = fit_limits(plants, quiet), fit_sources(plants)
    assert limits.weights[1] > 3.0 * max(abs(weight) for weight in limits.weights[2:])
    passing = sum(
        bool((p.candidates @ np.array(limits.weights) >= limits.evidence).any()) for p in quiet
    )
    assert passing == 1
    assert np.argmax(weights.member[:6]) == 3
    assert weights.member[6] == WEIGHTS.member[6]
    assert weights.member[7] > 0.5


def test_the_limit_holds_for_quiet_plants_that_were_not_drawn() -> None:
    """Of 120 that were drawn as many may pass as say with 95 % certainty that at most 5 % of all
    do, which is one; of fewer than 59 nothing can be said."""
    strongest = np.arange(120) / 10.0 + 0.003
    limit = limit_of(np.random.default_rng(1).permutation(strongest))
    assert (strongest >= limit).sum() == 1
    assert limit == pytest.approx(11.81)
    assert (np.arange(59) < limit_of(np.arange(59.0))).all()
    with pytest.raises(ValueError, match="58 quiet plants are too few"):
        limit_of(np.arange(58.0))


def test_a_plant_shows_its_candidates_and_the_evidence_of_its_groups() -> None:
    """As many rows as candidates; the group of a true source with connections known."""
    evidence = plant_evidence(plant_of(5151, 1))
    assert evidence.candidates.shape == (evidence.alike.size, 4)
    assert not evidence.quiet
    assert evidence.alike.max() > 0.5
    assert evidence.groups
    assert all(group.connected for group, _ in evidence.groups)
