"""``stemwatch robustness``: the same valves as other plants would have stored them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from collections.abc import Sequence

    from stemwatch.service.studies.robustness import Row


def robustness(
    valves: Annotated[
        int, typer.Option(min=1, max=2000, help="Sticking valves, and as many healthy ones.")
    ] = 40,
    seed: o.Seed = 2036,
    way: Annotated[
        list[str] | None,
        typer.Option(help="Only ways whose name contains this; may be given several times."),
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes.")] = None,
    json_file: o.JsonFile = None,
) -> None:
    """Count right and wrong answers on the same valves, stored as other plants would store them.

    Sticking (S 3 to 8 %) and healthy valves are simulated once, and each recording is changed in
    one way at a time: split ranges, positioner curves, a reversed position, a tight shut-off, late
    clocks, coarse steps, averages, slow and compressed archives. Nothing is hidden in them, so
    every effect that is named counts as an error.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.robustness import WAYS, rows, run_robustness

    storages = o.names_that_hold(way, WAYS, "--way", "way")
    views.say_if_not_blind(seed)
    with views.progress("recordings", 2 * valves * len(storages)) as advance:
        answers = run_robustness(valves, seed, storages, choose_executor(workers), advance)
    _print(list(rows(answers)))
    views.write_answers(answers, json_file)
    views.say_read_on("robustness.md")


def _print(rows: Sequence[Row]) -> None:
    from rich.table import Table

    from stemwatch.service.cli import views

    table = Table(title="The same valves, stored otherwise", title_justify="left")
    table.add_column("the same recording ...")
    for name in ("healthy", "sticking", "S", "S at least", "J", "named"):
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            row.way,
            f"{row.called_sticky}, {row.healthy_undetermined} of {row.healthy}",
            f"{row.missed} of {row.sticking}",
            _numbers("S", row.with_numbers, row.S_error, row.S_held, row.S_width),
            f"{row.at_least_held} of {row.S_at_least}" if row.S_at_least else "none",
            _numbers("J", row.with_numbers, row.J_error, row.J_held),
            f"{row.named} of {row.healthy + row.sticking}",
        )
    views.out.print(table)
    views.out.print(
        "healthy: called sticky, undetermined; sticking: neither sticky nor watch; S and J: median "
        "error in percent of OP, intervals that hold the truth (S: median width), or no S where no "
        "sticking valve was given one; at least: valves with only a bound of S, and how many "
        "bounds hold; named: valves of which an effect was named though nothing was hidden",
        highlight=False,
    )


def _numbers(name: str, total: int, error: float, covered: int, width: float | None = None) -> str:
    """What S or J came to over the sticking valves that were given one."""
    if not total:
        return f"no {name}"
    return f"{error:.2f}, {covered} of {total}" + ("" if width is None else f", {width:.2f}")
