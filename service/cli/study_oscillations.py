"""``stemwatch study-oscillations``: groups of oscillating loops and sources."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from stemwatch.models.studies.interacting_loops.fitting import PlantEvidence
    from stemwatch.service.studies.oscillations import PlantToDraw

_SETS_A_PLANT = 4  # plants for each set of unrelated loops


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
    from stemwatch.service.executors import choose_executor, results_in_order
    from stemwatch.service.studies.oscillations import (
        by_hours,
        evidence_of,
        seconds,
        study_figures,
    )

    seeds = [seed] if fit is None else _seeds(fit)
    items = [(each, number) for each in seeds for number in range(plants)]
    whole = len(items)
    if fit is not None:
        items += [(each, number) for each in seeds for number in range(plants, plants + quiet)]
    else:
        items += [(seed, -1 - number) for number in range(max(plants // _SETS_A_PLANT, 1))]
    with views.progress("plants", len(items), transient=True) as advance:
        work: Callable[[PlantToDraw], Any] = by_hours
        if fit is not None:
            work = partial(evidence_of, plants)
        results = results_in_order(choose_executor(workers), work, items, advance)
    if fit is not None:
        _print_fitted(results[:whole], [shown for shown in results[whole:] if shown])
        return
    figures = study_figures(results[:whole], results[whole:])
    if loops:
        figures[f"{loops} loops of a day, s on one core"] = round(seconds(loops), 1)
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
