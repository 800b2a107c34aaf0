"""The simulated plants for testing groups of oscillating loops, whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.oscillation_groups.find_groups import find_groups
from stemwatch.models.oscillation_groups.limits import LIMITS, WEIGHTS
from stemwatch.models.oscillation_groups.loop_spectra import loop_spectra
from stemwatch.models.oscillation_groups.sources import MemberEvidence
from stemwatch.models.studies.interacting_loops.draws import (
    EVERY,
    SCAN_S,
    Source,
    SourceKind,
    _of_source,
    draw_plant,
    labels_by_share,
    run_drawn,
    unrelated_loops,
)
from stemwatch.models.studies.interacting_loops.fitting import (
    PlantEvidence,
    fit_limits,
    fit_sources,
    limit_of,
    plant_evidence,
)
from stemwatch.models.studies.interacting_loops.score_plant import (
    adjusted_rand_index,
    first_hours,
    labels_found,
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


@pytest.mark.long
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


def test_unrelated_loops_are_of_a_plant_each() -> None:
    """As many as asked for, with nothing true to find among them, in two hours or all."""
    plant = unrelated_loops(np.random.default_rng(4064), 5)
    assert plant.pv.shape == plant.op.shape == plant.sp.shape
    assert plant.pv.shape[0] == 5
    assert np.abs(np.corrcoef(plant.pv) - np.eye(5)).max() < 0.9
    short = first_hours(plant, 2.0)
    assert short.pv.shape == (5, 720)
    judged = score_plant(short)
    assert judged.quiet
    assert judged.groups == ()


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
    assert labels_by_share(shares) == (1, 1, 1)
    assert labels_by_share(shares[:1]) == (-1, -1, -1)
    assert labels_by_share(np.zeros((0, 3))) == (-1, -1, -1)


def test_found_loops_are_labelled_by_the_rule_of_the_truth() -> None:
    """By the group with the largest share; a group that keeps one loop only is none."""
    values = np.random.default_rng(1).normal(size=(6, 4000)) * 0.3
    second = np.arange(4000) * 10.0
    for loop, (first, other) in {0: (3, 0), 1: (3, 0), 2: (1, 2), 3: (0, 3), 4: (3, 1.5)}.items():
        values[loop] += first * np.sin(second / 48.0) + other * np.sin(second / 120.0)
    spectra = loop_spectra(values, 10.0)
    groups = find_groups(spectra, spectra, LIMITS)
    assert sorted(group.members for group in groups) == [(0, 1, 2, 4), (2, 3, 4)]
    label = labels_found(groups, 6)
    assert label[0] == label[1] == label[4] != label[2] == label[3]
    assert label[5] == -1
    wide = next(group for group in groups if group.members == (0, 1, 2, 4))
    narrow = next(group for group in groups if group is not wide)
    alone = replace(narrow, members=(2, 3), shares=(0.12, 0.9))
    assert labels_found([wide, alone], 6) == (0, 0, 0, -1, 0, -1)
    assert labels_found([], 2) == (-1, -1)


@pytest.mark.parametrize("kind", list(SourceKind))
def test_a_source_acts_near_its_own_period(kind: SourceKind) -> None:
    """Whatever stronger and unsteadier the other loops do, and however slow loads are."""
    plant = draw_plant(np.random.default_rng(8383), sources=0)
    m, scans = plant.noise.shape
    second = np.arange(scans) * SCAN_S
    own = np.sin(2.0 * np.pi * second / 300.0)
    waves = np.zeros((m, scans))
    waves[2] = own if kind is SourceKind.WAVE else 0.0
    source = Source(kind, -1 if kind is SourceKind.WAVE else 2)
    plant = replace(plant, sources=(source,), waves=(waves,))
    op_without = 5.0 * np.sin(second / 2500.0) * np.ones((m, 1))
    op = op_without + 9.0 * np.sin(2.0 * np.pi * second / 1300.0) * (np.arange(m) == 5)[:, None]
    op[2] += own
    recorded = slice(EVERY - 1, None, EVERY)
    bins = _of_source(plant, 0, op[:, recorded], op_without[:, recorded])
    cycles = np.flatnonzero(bins) / (scans * SCAN_S / 300.0)
    assert cycles[0] == pytest.approx(0.75, abs=0.03)
    assert cycles[-1] == pytest.approx(3.25, abs=0.1)


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
