"""``stemwatch trial``: the rates of right and wrong verdicts on simulated valves."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stemwatch.service.studies.trial import Marked


def trial(
    loops: Annotated[
        int, typer.Option(min=2, max=5000, help="Healthy loops; half as many sticking ones.")
    ] = 240,
    seed: o.Seed = 2026,
    workers: o.Workers = None,
    narx: Annotated[
        bool, typer.Option("--narx/--no-narx", help="Train the networks too, as screen does.")
    ] = True,
    json_file: o.JsonFile = None,
) -> None:
    """Count right and wrong verdicts on simulated valves, with 95 % intervals.

    Healthy loops of all kinds (quiet, set-point moves, badly tuned, oscillating disturbance, noisy,
    small travel) and sticking ones of the four shapes, drawn at random and simulated by force
    balance. What is screened sees the recordings only. The intervals of S and J were calibrated
    with seed 11, which is not the default.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.seeds import INTERVALS_CALIBRATED_WITH
    from stemwatch.service.studies.trial import run_trial

    if seed == INTERVALS_CALIBRATED_WITH:
        views.say("Seed 11 is the one that intervals were calibrated with: these are not blind.")
    with views.progress("valves", loops + loops // 2) as advance:
        marks = run_trial(loops, seed, choose_executor(workers), advance, narx=narx)
    _print(marks)
    if json_file is not None:
        _write(marks, json_file)
    views.say_read_on("trial.md")


def _print(marks: Sequence[Marked]) -> None:
    from rich.table import Table

    from stemwatch.service.cli import views
    from stemwatch.service.studies.detection_rates import wilson
    from stemwatch.service.studies.trial import accuracy, rates, shapes

    table = Table(title="Verdicts", title_justify="left")
    for name in ("loops", "verdict", "count", "share", "95 % interval"):
        table.add_column(name, justify="left" if name in ("loops", "verdict") else "right")
    for group, verdict, count, total in rates(marks):
        low, high = wilson(count, total)
        share = f"{count / total:.1%}"
        table.add_row(group, verdict, f"{count} of {total}", share, f"{low:.1%} to {high:.1%}")
    views.out.print(table)
    for line in accuracy(marks):
        if line.of:
            views.out.print(
                f"{line.name}: median error {line.median_error:.2f} % of span; the interval holds "
                f"the truth in {line.within} of {line.of} ({line.within / line.of:.0%})",
                highlight=False,
            )
    right = "; ".join(f"{shape} {hits} of {total}" for shape, hits, total in shapes(marks) if total)
    if right:
        views.out.print(f"Shape named right: {right}", highlight=False)
    seconds = sum(mark.seconds for mark in marks) / max(len(marks), 1)
    views.out.print(f"{seconds:.2f} s a valve", highlight=False)


def _write(marks: Sequence[Marked], json_file: Path) -> None:
    from stemwatch.service.cli import views

    objects = [
        {**asdict(mark), "truth": mark.truth.as_json(), "verdict": mark.verdict.value}
        for mark in marks
    ]
    views.write_json(json_file, objects, allow_nan=True)
