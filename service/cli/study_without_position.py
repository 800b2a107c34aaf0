"""``stemwatch study-without-position``: how well OP and PV alone reveal a sticking valve."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from rich.progress import Progress
    from rich.table import Table

    from stemwatch.models.without_position.suspicion import Judge
    from stemwatch.service.executors import Executor
    from stemwatch.service.studies.without_position.count import FamilyRow
    from stemwatch.service.studies.without_position.several_recordings import (
        InOrderRow,
        RecordedLoop,
        TogetherRow,
    )


def study_without_position(
    loops: Annotated[
        int, typer.Option(min=20, max=10_000, help="Loops of each family, every other one sticks.")
    ] = 240,
    seed: o.Seed = 2126,
    train: Annotated[
        int | None,
        typer.Option(min=100, max=100_000, help="Train anew on so many simulated loops."),
    ] = None,
    train_seed: Annotated[
        int,
        typer.Option(
            min=0, help="Seed of those loops; the next seed draws the loops of the limits."
        ),
    ] = 11,
    save: Annotated[
        Path | None, typer.Option(help="Write the networks trained anew into this module.")
    ] = None,
    recordings: Annotated[
        int,
        typer.Option(
            min=1,
            max=16,
            help="Recordings of each loop that are judged together, by the networks in use.",
        ),
    ] = 8,
    workers: o.Workers = None,
    json_file: o.JsonFile = None,
) -> None:
    """Count what OP and PV alone would tell of simulated valves whose position is left out.

    Judges the networks that screening uses, or with --train those it trains first, on simulated
    loops alone; as many of another seed then give the limits.
    """
    from rich.progress import Progress

    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.without_position.count import family_rows, run_study
    from stemwatch.service.studies.without_position.draw import FAMILIES
    from stemwatch.service.studies.without_position.several_recordings import (
        in_order_rows,
        run_several_recordings,
        together_rows,
    )

    if save is not None and train is None:
        raise typer.BadParameter("--save writes what --train made: give --train as well")

    executor = choose_executor(workers)
    with Progress(console=views.err, transient=True) as progress:
        judge = _judge(train, train_seed, save, executor, progress)
        bar = progress.add_task("loops", total=loops * len(FAMILIES))
        answers = run_study(
            judge, loops, seed, executor, lambda n: progress.update(bar, completed=n)
        )
        bar = progress.add_task("loops recorded again", total=loops)
        recorded = run_several_recordings(
            loops, recordings, seed, executor, lambda n: progress.update(bar, completed=n)
        )
    for table in _tables(seed, list(family_rows(answers))):
        views.out.print(table)
    views.out.print(_table_together(recorded, list(together_rows(recorded))))
    views.out.print(_table_in_order(recordings, list(in_order_rows(recorded))))
    views.write_answers(answers, json_file)
    views.say_read_on("without-position.md")


def _judge(
    train: int | None, train_seed: int, save: Path | None, executor: Executor, progress: Progress
) -> Judge:
    """The networks in use, or those that are trained now."""
    from stemwatch.models.without_position.suspicion import trained_judge
    from stemwatch.service.studies.without_position.training import (
        items_of_training,
        module_of,
        run_training,
    )

    if train is None:
        return trained_judge()
    total = sum(map(len, items_of_training(train, train_seed)))
    bar = progress.add_task("training loops", total=total)
    judge = run_training(train, train_seed, executor, lambda n: progress.update(bar, completed=n))
    if save is not None:
        save.write_text(module_of(judge, train, train_seed), encoding="utf-8")
    return judge


def _table_together(loops: Sequence[RecordedLoop], rows: Sequence[TogetherRow]) -> Table:
    from stemwatch.service.cli.views import plain_table

    sticking = sum(loop.sticky for loop in loops)
    title = f"Own loops suspected by several recordings, {sticking} + {len(loops) - sticking}"
    table = plain_table(title, ("recordings",), ("together", "any one", "at least half"))
    for row in rows:
        counts = (row.together, row.any_one, row.half)
        table.add_row(str(row.recordings), *(f"{found} + {false}" for found, false in counts))
    return table


def _table_in_order(recordings: int, rows: Sequence[InOrderRow]) -> Table:
    from stemwatch.service.cli.views import plain_table

    title = f"The same loops, suspected where {recordings} recordings come one after the other"
    table = plain_table(title, ("by",), ("after the last", "at some time"))
    for row in rows:
        counts = (row.at_the_end, row.at_some_time)
        table.add_row(row.by, *(f"{found} + {false}" for found, false in counts))
    return table


def _tables(seed: int, rows: Sequence[FamilyRow]) -> Iterator[Table]:
    """A row for each family in two tables, each of which fits into eighty columns: what was said,
    and how well."""
    from stemwatch.service.cli.views import plain_table

    title = f"Valves without a position, seed {seed}: sticking + sound loops"
    said = plain_table(title, ("family",), ("suspected", "no sign", "missed", "cannot tell"))
    columns = ("AUC", "score: 2, 5 %", "all rules: 2, 5 %", "error", "intervals")
    measured = plain_table(
        "Sticking loops found at 2 and 5 % false alarms, and their S", ("family",), columns
    )
    for row in rows:
        suspected, no_sign, cannot_tell = (
            f"{sticking} + {sound}"
            for sticking, sound in (row.suspected, row.no_sign, row.cannot_tell)
        )
        said.add_row(
            f"{row.family}, {row.sticking} + {row.sound}",
            suspected,
            no_sign,
            f"{row.missed}",
            cannot_tell,
        )
        measured.add_row(
            row.family,
            f"{row.auc:.2f}",
            f"{row.sensitivity[0]:.2f}, {row.sensitivity[1]:.2f}",
            f"{row.found[0]:.2f}, {row.found[1]:.2f}",
            f"{row.error:.2f} %",
            f"{row.held[0]} of {row.held[1]}",
        )
    yield said
    yield measured
