"""How well groups and sources are found in plants in which both are known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.oscillation_groups.find_groups import FoundGroup, find_groups
from stemwatch.models.oscillation_groups.limits import LIMITS, WEIGHTS
from stemwatch.models.oscillation_groups.loop_spectra import loop_spectra
from stemwatch.models.oscillation_groups.plant_groups import log_odds
from stemwatch.models.oscillation_groups.sources import (
    MemberEvidence,
    member_evidence,
    rank_sources,
    without_connections,
)
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.studies.interacting_loops.draws import (
    RunPlant,
    draw_plant,
    labels_by_share,
    run_drawn,
    unrelated_loops,
)
from stemwatch.models.without_position.suspicion import look_at_loop, trained_judge

UNRELATED = 15  # loops of a set, as many as a unit of a plant has
_SETS = 1_000_000  # beyond the numbers of plants of a seed


@dataclass(frozen=True, kw_only=True)
class ScoredGroup:
    """A group that was found: the true kind of source of most of its members, and the rank of the
    true source. ``place`` 0 is first, -1 not among the candidates; ``place_by_connections`` is the
    rank where the plant file names connections.
    """

    kind: str  # of the source; empty where no source moves these loops
    place: int = -1
    place_by_connections: int = -1


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
    """Plant ``number`` of ``seed``; it does not depend on which others are drawn."""
    return run_drawn(draw_plant(np.random.default_rng((seed, number))))


def unrelated_of(seed: int, number: int) -> RunPlant:
    """Set ``number`` of ``UNRELATED`` loops of ``seed`` that have nothing to do with each other."""
    return unrelated_loops(np.random.default_rng((seed, _SETS, number)), UNRELATED)


def first_hours(plant: RunPlant, hours: float) -> RunPlant:
    """The beginning of a plant's recording; what is true of it stays that of the whole."""
    samples = round(hours * 3600.0 / plant.interval_s)
    return replace(
        plant, sp=plant.sp[:, :samples], pv=plant.pv[:, :samples], op=plant.op[:, :samples]
    )


class PlantSuspicions(Mapping[int, float]):
    """The log odds of sticking from OP and PV, for each loop where they can be judged, as in a run
    of ``screen``. A loop is judged when it is first asked for, which most are not.
    """

    def __init__(self, plant: RunPlant) -> None:
        self._plant = plant
        self._scores: dict[int, float | None] = {}

    def __getitem__(self, loop: int) -> float:
        if loop not in self._scores:
            seen = look_at_loop(_recording(self._plant, loop))
            self._scores[loop] = trained_judge().says(seen).likeness
        score = self._scores[loop]
        if score is None:
            raise KeyError(loop)
        return log_odds(score)

    def __iter__(self) -> Iterator[int]:
        return (loop for loop in range(len(self._plant.units)) if self.get(loop) is not None)

    def __len__(self) -> int:
        return sum(1 for _ in self)


def _recording(plant: RunPlant, loop: int) -> Recording:
    signals = {
        role: Signal.good(getattr(plant, role.value)[loop], role.value)
        for role in (Role.OP, Role.PV, Role.SP)
    }
    return Recording(valve=str(loop), signals=signals, interval_s=plant.interval_s)


def score_plant(plant: RunPlant) -> ScoredPlant:
    """Find the groups of a plant, rank their sources, and compare with the truth."""
    errors = loop_spectra(plant.sp - plant.pv, plant.interval_s)
    outputs = loop_spectra(plant.op, plant.interval_s)
    suspicion = PlantSuspicions(plant)
    groups = find_groups(errors, loop_spectra(plant.pv, plant.interval_s), LIMITS, suspicion)
    scored = [
        _scored(plant, member_evidence(errors, outputs, group, suspicion, feeds=plant.feeds))
        for group in groups
    ]
    label = np.array(plant.label)
    quiet = bool((label < 0).all())
    index = None if quiet else adjusted_rand_index(plant.label, labels_found(groups, label.size))
    return ScoredPlant(
        loops=label.size, sources=len(plant.sources), rand_index=index, groups=tuple(scored)
    )


def labels_found(groups: Sequence[FoundGroup], loops: int) -> tuple[int, ...]:
    """The group of each loop by the rule that gives it its true source."""
    shares = np.zeros((len(groups), loops))
    for row, group in zip(shares, groups, strict=True):
        row[list(group.members)] = group.shares
    return labels_by_share(shares)


def _scored(plant: RunPlant, evidence: MemberEvidence) -> ScoredGroup:
    true = [plant.label[loop] for loop in evidence.members]
    commonest = max(sorted(set(true)), key=true.count)
    if commonest < 0:
        return ScoredGroup(kind="")
    source = plant.sources[commonest]
    return ScoredGroup(
        kind=source.kind.value,
        place=_place(without_connections(evidence), source.loop),
        place_by_connections=_place(evidence, source.loop),
    )


def _place(evidence: MemberEvidence, loop: int) -> int:
    ranking = rank_sources(evidence, WEIGHTS)
    ranked = sorted(
        [*zip(ranking.probability, ranking.members, strict=True), (ranking.none, -1)],
        key=lambda pair: -pair[0],
    )
    places = [member for _, member in ranked]
    return places.index(loop) if loop in places else -1


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
