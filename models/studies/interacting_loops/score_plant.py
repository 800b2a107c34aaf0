"""How well groups and sources are found in plants in which both are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.oscillation_groups.find_groups import find_groups, labels
from stemwatch.models.oscillation_groups.limits import LIMITS, WEIGHTS, GroupLimits
from stemwatch.models.oscillation_groups.loop_spectra import loop_spectra, oscillations
from stemwatch.models.oscillation_groups.sources import (
    MemberEvidence,
    member_evidence,
    non_linearity,
    rank_sources,
)
from stemwatch.models.studies.interacting_loops.draws import RunPlant, draw_plant, run_drawn


@dataclass(frozen=True, kw_only=True)
class ScoredGroup:
    """A group that was found: what most of its members really oscillate with, and where the true
    source stands in the ranking. ``place`` 0 is first, -1 not among the candidates."""

    kind: str  # of the source; empty where no source moves these loops
    place: int
    source: int  # its loop, -1 for outside
    evidence: MemberEvidence


@dataclass(frozen=True, kw_only=True)
class ScoredPlant:
    """``rand_index`` the adjusted Rand index of the groups (Hubert and Arabie 1985), ``None`` for a
    plant in which no loop oscillates."""

    loops: int
    sources: int
    rand_index: float | None
    groups: tuple[ScoredGroup, ...]

    @property
    def quiet(self) -> bool:
        return self.rand_index is None


def plant_of(seed: int, number: int) -> RunPlant:
    """Plant ``number`` of ``seed``; the same whichever others are made."""
    return run_drawn(draw_plant(np.random.default_rng((seed, number))))


def score_plant(plant: RunPlant, limits: GroupLimits = LIMITS) -> ScoredPlant:
    """The groups of a plant and the ranking of each, against what is true."""
    errors = loop_spectra(plant.sp - plant.pv, plant.interval_s)
    outputs = loop_spectra(plant.op, plant.interval_s)
    groups = find_groups(errors, limits)
    scored = []
    for group in groups:
        evidence = member_evidence(
            errors,
            outputs,
            group,
            lambda i: non_linearity(plant.op[i], plant.pv[i]),
        )
        scored.append(_scored(plant, evidence))
    label = np.array(plant.label)
    quiet = bool((label < 0).all())
    index = None if quiet else adjusted_rand_index(plant.label, labels(groups, label.size))
    return ScoredPlant(
        loops=label.size, sources=len(plant.sources), rand_index=index, groups=tuple(scored)
    )


def _scored(plant: RunPlant, evidence: MemberEvidence) -> ScoredGroup:
    true = [plant.label[loop] for loop in evidence.members]
    commonest = max(sorted(set(true)), key=true.count)
    if commonest < 0:
        return ScoredGroup(kind="", place=-1, source=-1, evidence=evidence)
    source = plant.sources[commonest]
    ranking = rank_sources(evidence, WEIGHTS)
    order = sorted(
        [*zip(ranking.probability, ranking.members, strict=True), (ranking.none, -1)],
        key=lambda pair: -pair[0],
    )
    places = [loop for _, loop in order]
    rank = places.index(source.loop) if source.loop in places else -1
    return ScoredGroup(kind=source.kind.value, place=rank, source=source.loop, evidence=evidence)


def null_statistics(plant: RunPlant) -> tuple[float, float] | None:
    """Of a plant without sources: the largest regularity of an oscillation with the prominence and
    share of the limits, and the largest prominence of a regular one; ``None`` of other plants."""
    if plant.sources:
        return None
    of_each_loop = oscillations(loop_spectra(plant.sp - plant.pv, plant.interval_s))
    tall = [peak.regularity for peak in of_each_loop if peak.prominence >= LIMITS.prominence
            and peak.share >= LIMITS.share]  # fmt: skip
    regular = [peak.prominence for peak in of_each_loop if peak.regularity >= LIMITS.regularity
               and peak.share >= LIMITS.share]  # fmt: skip
    return max(tall, default=0.0), max(regular, default=0.0)


def adjusted_rand_index(a: Sequence[int], b: Sequence[int]) -> float:
    """Agreement of two partitions, 1 for equal ones, 0 by chance (Hubert and Arabie 1985)."""
    label_index = np.unique(np.asarray(a), return_inverse=True)[1]
    other = np.unique(np.asarray(b), return_inverse=True)[1]
    table = np.zeros((label_index.max() + 1, other.max() + 1))
    np.add.at(table, (label_index, other), 1.0)

    def pairs(counts: np.ndarray) -> float:
        return float((counts * (counts - 1.0) / 2.0).sum())

    same_in_both, first, second = pairs(table), pairs(table.sum(axis=1)), pairs(table.sum(axis=0))
    expected = first * second / max(len(label_index) * (len(label_index) - 1) / 2.0, 1.0)
    largest_possible = (first + second) / 2.0
    return (
        1.0
        if largest_possible == expected
        else (same_in_both - expected) / (largest_possible - expected)
    )
