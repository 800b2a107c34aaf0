"""``stemwatch study-oscillations``: groups of oscillating loops and sources."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from stemwatch.models.studies.interacting_loops.fitting import PlantEvidence
    from stemwatch.models.studies.interacting_loops.score_plant import ScoredPlant

_DAY = 8640  # samples of 10 s
_HOURS = (2.0, 4.0)  # of recordings that are judged beside the whole ones of twelve hours
_WHOLE = 12.0
_SETS_A_PLANT = 4  # plants for each set of unrelated loops
_KINDS = ("sticking valve", "tight loop", "external wave")


def study_oscillations(
    plants: Annotated[int, typer.Option(min=4, max=10_000, help="Simulated plants.")] = 200,
    seed: o.Seed = 2130,
    loops: Annotated[
        int, typer.Option(min=0, help="Loops of one day each, timed on one core; 0 leaves it out.")
    ] = 1000,
    fit: Annotated[
        str | None,
        typer.Option(
            metavar="SEEDS",
            help="Judge nothing, but print limits and weights by so many plants of each of these "
            "seeds, such as 5151,6161.",
        ),
    ] = None,
    quiet: Annotated[
        int,
        typer.Option(
            min=0,
            help="With --fit: so many further plants of each seed, of which the quiet ones give "
            "the limit.",
        ),
    ] = 120,
    workers: o.Workers = None,
    json_file: o.JsonFile = None,
) -> None:
    """Count which groups of loops that oscillate together, and which sources, are found.

    Plants of 10 to 40 loops that act on each other, with no source or up to three: a sticking
    valve, a loop at its stability limit, a wave from outside. What is true comes from running each
    plant with one source at a time. Beside them stand sets of loops each of another plant, which no
    group can join.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor, map_items

    done: dict[int, Any] = {}
    seeds = [seed] if fit is None else _seeds(fit)
    items = [(each, number) for each in seeds for number in range(plants)]
    whole = len(items)
    if fit is not None:
        items += [(each, number) for each in seeds for number in range(plants, plants + quiet)]
    else:
        items += [(seed, -1 - number) for number in range(max(plants // _SETS_A_PLANT, 1))]
    with views.progress("plants", len(items), transient=True) as advance:
        work: Callable[[tuple[int, int]], Any] = _score_one_plant
        if fit is not None:
            work = partial(_look_at_one_plant, plants)
        for index, result in map_items(choose_executor(workers), work, items):
            done[index] = result
            advance(len(done))
    results = [done[index] for index in sorted(done)]
    if fit is not None:
        _print_fitted(results[:whole], [shown for shown in results[whole:] if shown])
        return
    figures = _figures([by_hours[_WHOLE] for by_hours in results[:whole]])
    figures |= _by_length(results[:whole], results[whole:])
    if loops:
        figures[f"{loops} loops of a day, s on one core"] = round(_seconds(loops), 1)
    for name, value in figures.items():
        views.out.print(f"{name}: {value}", highlight=False)
    if json_file is not None:
        views.write_json(json_file, figures, allow_nan=True)
    views.say_read_on("oscillation-groups.md")


def _seeds(text: str) -> list[int]:
    try:
        return [int(part) for part in text.split(",")]
    except ValueError:
        raise typer.BadParameter(f"--fit {text}: expected seeds such as 5151,6161") from None


def _score_one_plant(item: tuple[int, int]) -> dict[float, ScoredPlant]:
    """By the hours of its recording; a number below 0 is a set of unrelated loops."""
    from stemwatch.models.studies.interacting_loops.score_plant import (
        first_hours,
        plant_of,
        score_plant,
        unrelated_of,
    )

    seed, number = item
    plant = plant_of(seed, number) if number >= 0 else unrelated_of(seed, -1 - number)
    return {hours: score_plant(first_hours(plant, hours)) for hours in (*_HOURS, _WHOLE)}


def _look_at_one_plant(plants: int, item: tuple[int, int]) -> PlantEvidence | None:
    """``None`` for one of the further plants in which loops oscillate."""
    from stemwatch.models.studies.interacting_loops.fitting import plant_evidence
    from stemwatch.models.studies.interacting_loops.score_plant import plant_of

    plant = plant_of(*item)
    return plant_evidence(plant) if item[1] < plants or set(plant.label) == {-1} else None


def _print_fitted(plants: Sequence[PlantEvidence], quiet: Sequence[PlantEvidence]) -> None:
    """What stands in ``models/oscillation_groups/limits.py``."""
    from stemwatch.models.studies.interacting_loops.fitting import fit_limits, fit_sources
    from stemwatch.service.cli import views

    try:
        limits = fit_limits(plants, quiet)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    views.out.print(f"{len(plants)} plants, and {len(quiet)} quiet ones", highlight=False)
    views.out.print(f"LIMITS = {limits}", highlight=False)
    views.out.print(f"WEIGHTS = {fit_sources(plants)}", highlight=False)


def _share(count: int, total: int) -> str:
    return f"{count} of {total} ({100.0 * count / total:.0f} %)" if total else "none"


def _by_length(
    plants: Sequence[dict[float, ScoredPlant]], unrelated: Sequence[dict[float, ScoredPlant]]
) -> dict[str, Any]:
    """How often a group is found where there is none, and where there are some, by the hours that
    were recorded."""

    def with_a_group(of: Sequence[dict[float, ScoredPlant]], hours: float) -> str:
        return _share(sum(bool(each[hours].groups) for each in of), len(of))

    quiet = [each for each in plants if each[_WHOLE].quiet]
    moved = [each for each in plants if not each[_WHOLE].quiet]
    figures: dict[str, Any] = {}
    for hours in (*_HOURS, _WHOLE):
        recorded = f"{hours:g} h recorded"
        figures |= {
            f"{recorded}: sets of unrelated loops with a group": with_a_group(unrelated, hours),
            f"{recorded}: quiet plants with a group": with_a_group(quiet, hours),
            f"{recorded}: plants with groups in which one is found": with_a_group(moved, hours),
        }
    return figures


def _figures(results: Sequence[ScoredPlant]) -> dict[str, Any]:
    """The figures by name."""
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
    for kind in _KINDS:
        of_kind = [group for group in true if group.kind == kind]
        figures[f"{kind}: source first"] = _share(
            sum(group.place == 0 for group in of_kind), len(of_kind)
        )
    return figures


def _seconds(loops: int) -> float:
    """Processor time for the groups of so many loops of one day, made of drawn plants."""
    import numpy as np

    from stemwatch.models.oscillation_groups.find_groups import find_groups
    from stemwatch.models.oscillation_groups.limits import LIMITS
    from stemwatch.models.oscillation_groups.loop_spectra import loop_spectra
    from stemwatch.models.studies.interacting_loops.score_plant import plant_of

    rows: list[Any] = []
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
