"""``stemwatch study-without-position``: what OP and PV alone would tell of a valve."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer

from stemwatch.service.cli import options as o


def study_without_position(
    loops: Annotated[
        int, typer.Option(min=20, max=10_000, help="Loops of each family, every other one sticks.")
    ] = 240,
    seed: o.Seed = 2042,
    train: Annotated[
        int, typer.Option(min=100, max=100_000, help="Simulated loops to train on.")
    ] = 5000,
    train_seed: Annotated[
        int, typer.Option(min=0, help="Draws those, and the next the limits.")
    ] = 11,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes.")] = None,
    json_file: o.JsonFile = None,
) -> None:
    """Count what OP and PV alone would tell of simulated valves whose position is left out.

    Trains two small networks on simulated loops first, half as many of another seed give the
    limits. Screening does not use them: on real loops they are not good enough yet.
    """
    from rich.progress import Progress

    from stemwatch.service.cli import views
    from stemwatch.service.cli.prove_tables import plain_table
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.position_free import (
        FAMILIES,
        family_rows,
        run_position_free,
        run_training,
    )

    executor = choose_executor(workers)
    with Progress(console=views.err, transient=True) as progress:
        bar = progress.add_task("training loops", total=train + train // 2)
        judge = run_training(
            train, train_seed, executor, lambda n: progress.update(bar, completed=n)
        )
        bar = progress.add_task("loops", total=loops * len(FAMILIES))
        answers = run_position_free(
            judge, loops, seed, executor, lambda n: progress.update(bar, completed=n)
        )
    columns = (
        "suspected",
        "no sign",
        "cannot tell",
        "AUC",
        "found at 2, 5 %",
        "error of S",
        "intervals",
    )
    title = f"Valves without a position, seed {seed}: sticking + sound loops"
    table = plain_table(title, ("family",), columns)
    for row in family_rows(answers):
        table.add_row(
            f"{row.family}, {row.sticking} + {row.sound}",
            *(f"{a} + {b}" for a, b in (row.suspected, row.no_sign, row.cannot_tell)),
            f"{row.auc:.2f}",
            f"{row.sensitivity[0]:.2f}, {row.sensitivity[1]:.2f}",
            f"{row.error:.2f} %",
            f"{row.held[0]} of {row.held[1]}",
        )
    views.out.print(table)
    if json_file is not None:
        objects = [{**asdict(answer), "verdict": answer.verdict.value} for answer in answers]
        json_file.write_text(json.dumps(objects, indent=1) + "\n", encoding="utf-8")
    views.say_read_on("without-position.md")
