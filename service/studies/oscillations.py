"""How often groups of loops that oscillate together, and their sources, are found in simulated
plants, counted."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from stemwatch.models.oscillation_groups.find_groups import find_groups
from stemwatch.models.oscillation_groups.limits import LIMITS
from stemwatch.models.oscillation_groups.loop_spectra import loop_spectra
from stemwatch.models.recording import Floats
from stemwatch.models.studies.interacting_loops.draws import SourceKind
from stemwatch.models.studies.interacting_loops.fitting import PlantEvidence, plant_evidence
from stemwatch.models.studies.interacting_loops.score_plant import (
    ScoredPlant,
    first_hours,
    plant_of,
    score_plant,
    unrelated_of,
)

HOURS = (2.0, 4.0)  # of recordings that are judged beside the whole ones of twelve hours
WHOLE = 12.0
_DAY = 8640  # samples of 10 s

PlantToDraw = tuple[int, int]  # seed and number; a number below 0 is a set of unrelated loops
ByHours = dict[float, ScoredPlant]


def by_hours(item: PlantToDraw) -> ByHours:
    """How well its groups are found, by the hours of its recording."""
    seed, number = item
    plant = plant_of(seed, number) if number >= 0 else unrelated_of(seed, -1 - number)
    return {hours: score_plant(first_hours(plant, hours)) for hours in (*HOURS, WHOLE)}


def evidence_of(plants: int, item: PlantToDraw) -> PlantEvidence | None:
    """What limits and weights are fitted to; ``None`` for a plant numbered ``plants`` or more in
    which loops oscillate: of those only the quiet ones count."""
    plant = plant_of(*item)
    return plant_evidence(plant) if item[1] < plants or set(plant.label) == {-1} else None


def study_figures(plants: Sequence[ByHours], unrelated: Sequence[ByHours]) -> dict[str, Any]:
    """The figures by name: of whole recordings, then by the hours that were recorded."""
    figures = _of_whole_recordings([scored[WHOLE] for scored in plants])
    return figures | _by_length(plants, unrelated)


def _of_whole_recordings(results: Sequence[ScoredPlant]) -> dict[str, Any]:
    index = [plant.rand_index for plant in results if plant.rand_index is not None]
    quiet = [plant for plant in results if plant.quiet]
    groups = [group for plant in results if not plant.quiet for group in plant.groups]
    true = [group for group in groups if group.kind]

    figures: dict[str, Any] = {
        "plants with groups, quiet plants": [len(index), len(quiet)],
        "adjusted Rand index, mean": round(sum(index) / len(index), 3) if index else None,
        "adjusted Rand index, median": round(sorted(index)[len(index) // 2], 3) if index else None,
        "groups found, of them of no source": [len(groups), len(groups) - len(true)],
        "true source first": _share(sum(group.place == 0 for group in true), len(true)),
        "true source among the first two": _share(
            sum(group.place in (0, 1) for group in true), len(true)
        ),
        "true source first, connections known": _share(
            sum(group.place_by_connections == 0 for group in true), len(true)
        ),
        "true source among the first two, connections known": _share(
            sum(group.place_by_connections in (0, 1) for group in true), len(true)
        ),
        "quiet plants with a group": _share(sum(bool(p.groups) for p in quiet), len(quiet)),
    }
    for kind in SourceKind:
        of_kind = [group for group in true if group.kind == kind.value]
        figures[f"{kind.value}: source first"] = _share(
            sum(group.place == 0 for group in of_kind), len(of_kind)
        )
    return figures


def _by_length(plants: Sequence[ByHours], unrelated: Sequence[ByHours]) -> dict[str, Any]:
    """How often a group is found where there is none, and where there are some, by the hours that
    were recorded."""

    def with_a_group(of: Sequence[ByHours], hours: float) -> str:
        return _share(sum(bool(each[hours].groups) for each in of), len(of))

    quiet = [each for each in plants if each[WHOLE].quiet]
    moved = [each for each in plants if not each[WHOLE].quiet]
    figures: dict[str, Any] = {}
    for hours in (*HOURS, WHOLE):
        recorded = f"{hours:g} h recorded"
        figures |= {
            f"{recorded}: sets of unrelated loops with a group": with_a_group(unrelated, hours),
            f"{recorded}: quiet plants with a group": with_a_group(quiet, hours),
            f"{recorded}: plants with groups in which one is found": with_a_group(moved, hours),
        }
    return figures


def _share(count: int, total: int) -> str:
    return f"{count} of {total} ({100.0 * count / total:.0f} %)" if total else "none"


def seconds(loops: int) -> float:
    """Processor time for the groups of so many loops of one day, made of drawn plants."""
    rows: list[Floats] = []
    number = 0
    while len(rows) < loops:
        plant = plant_of(1, number)
        number += 1
        doubled = np.concatenate([plant.sp - plant.pv, (plant.sp - plant.pv)[:, ::-1]], axis=1)
        rows += list(doubled[:, :_DAY])
    errors = np.array(rows[:loops])
    started = time.process_time()
    spectra = loop_spectra(errors, 10.0)
    find_groups(spectra, spectra, LIMITS)
    return time.process_time() - started
