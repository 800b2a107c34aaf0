"""``stemwatch robustness``: the same valves as other plants would have stored them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stemwatch.service.studies.robustness import Row

COLUMNS = (
    "the same recording ...",
    "healthy: called sticky, undetermined",
    "sticking: neither sticky nor watch",
    "S: error, intervals that hold, width",
    "S at least: bounds that hold",
    "J: error, intervals that hold",
    "named in error",
)


def robustness(
    valves: Annotated[
        int, typer.Option(min=1, max=2000, help="Sticking valves, and as many healthy ones.")
    ] = 40,
    seed: o.Seed = 2036,
    way: Annotated[
        list[str] | None,
        typer.Option(help="Only ways whose name contains this; may be given several times."),
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            help="Keep each answer in this folder as it comes, and go on from there: after a stop, "
            "or way by way."
        ),
    ] = None,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the table as docs/robustness.md has it.")
    ] = False,
    workers: o.Workers = None,
    json_file: o.JsonFile = None,
) -> None:
    """Count right and wrong answers on the same valves, stored as other plants would store them.

    Sticking (S 3 to 8 %) and healthy valves are simulated once, and each recording is changed in
    one way at a time: split ranges, positioner curves, a reversed position, a tight shut-off, late
    clocks, coarse steps, averages, slow and compressed archives. Nothing is hidden in them, so
    every effect that is named counts as an error. All ways take hours: with --keep they may be
    counted one by one, and asked for together they are one table. A folder belongs to one version
    of the program.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.robustness import WAYS, rows, run_robustness

    ways = o.names_that_hold(way, WAYS, "--way", "way")
    views.say_if_not_blind(seed)
    if keep is not None:
        keep.mkdir(parents=True, exist_ok=True)
    with views.progress("recordings", 2 * valves * len(ways)) as advance:
        executor = choose_executor(workers)
        answers = run_robustness(valves, seed, ways, executor, advance, keep)
    _print(table := list(rows(answers)), markdown=markdown)
    _print_coverage(table)
    views.write_answers(answers, json_file)
    views.say_read_on("robustness.md")


def _print(rows: Sequence[Row], *, markdown: bool) -> None:
    from rich.table import Table

    from stemwatch.service.cli import views

    cells = [_cells(row) for row in rows]
    if markdown:
        for line in (COLUMNS, ("---",) * len(COLUMNS), *cells):
            typer.echo(f"| {' | '.join(line)} |")
        return
    table = Table(*COLUMNS, title="The same valves, stored otherwise", title_justify="left")
    for line in cells:
        table.add_row(*line)
    views.out.print(table)
    views.out.print(
        "Errors of S and J are medians in percent of OP, the width is the median of the intervals "
        "of S; named in error are valves of which an effect was named though nothing was hidden.",
        highlight=False,
    )


def _print_coverage(rows: Sequence[Row]) -> None:
    """The intervals of all ways together, and in how many ways too few or too many hold."""
    from stemwatch.service.studies.robustness import HOLD, NOMINAL_SHARE, coverage

    numbers = [row.with_numbers for row in rows]
    for name, held in (("S", [row.S_held for row in rows]), ("J", [row.J_held for row in rows])):
        all_ways = coverage(held, numbers)
        if all_ways.of:
            typer.echo(
                f"{all_ways.held} of {all_ways.of} intervals of {name} hold "
                f"({all_ways.held / all_ways.of:.1%}); in {all_ways.outside} of {all_ways.ways} "
                f"ways fewer than {HOLD[0]:.0%} or more than {HOLD[1]:.0%}, beyond chance (where "
                f"each holds with {NOMINAL_SHARE:.0%}, chance puts the bare share outside in "
                f"{all_ways.by_chance:.1f})."
            )


def _cells(row: Row) -> tuple[str, ...]:
    """The row as the table has it."""
    numbers = row.with_numbers
    return (
        row.way,
        f"{row.called_sticky}, {row.healthy_undetermined} of {row.healthy}",
        f"{row.missed} of {row.sticking}",
        f"{row.S_error:.2f} %, {row.S_held} of {numbers}, {row.S_width:.1f} %"
        if numbers
        else "no S",
        f"{row.at_least_held} of {row.S_at_least}" if row.S_at_least else "none",
        f"{row.J_error:.2f} %, {row.J_held} of {numbers}" if numbers else "no J",
        f"{row.named} of {row.healthy + row.sticking}",
    )
