"""``stemwatch simulate-archive``: a company's archive of simulated valves."""

from __future__ import annotations

from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from stemwatch.service.cli import options as o

MIDNIGHT = datetime(2026, 3, 2, tzinfo=UTC)


class ArchiveFormat(StrEnum):
    """What an archive's files are."""

    PARQUET = "parquet"
    CSV = "csv"


def simulate_archive(
    folder: Annotated[Path, typer.Argument(help="Folder to write into.")],
    valves: Annotated[int, typer.Option(min=1, help="How many.")] = 100,
    hours: Annotated[float, typer.Option(min=0.01, help="Length of the recordings.")] = 24.0,
    step_s: Annotated[float, typer.Option(min=0.01, help="Seconds between samples.")] = 1.0,
    file_format: Annotated[
        ArchiveFormat, typer.Option("--format", help="What the files are.")
    ] = ArchiveFormat.PARQUET,
    distinct: Annotated[
        int,
        typer.Option(
            min=0,
            help="Simulate only so many loops and use each again, shifted in time and with fresh "
            "noise: quick, for timing only. 0 simulates every valve.",
        ),
    ] = 0,
    start: Annotated[str, typer.Option(help="Time of the first sample, ISO, UTC.")] = "",
    seed: o.Seed = 1,
    workers: o.Workers = None,
) -> None:
    """Write a company's archive of simulated valves, its plant.toml, and the truth beside it.

    One valve in five sticks. Parquet: folders by date with a row for each instant of a valve. CSV:
    a wide file for every eight valves. A day of a valve at 1 s takes about three seconds of one
    core and 1.5 MB of Parquet.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.executors import choose_executor
    from stemwatch.service.studies.simulated_archive import ArchivePlan, write_archive

    plan = ArchivePlan(
        valves=valves,
        hours=hours,
        interval_s=step_s,
        distinct=distinct,
        seed=seed,
        start=o.instant(start, "UTC", "--start") or MIDNIGHT,
        format=file_format.value,
    )
    if plan.loops < plan.valves:
        views.say(
            f"{plan.loops} loops are simulated for {plan.valves} valves: each is used again, "
            "shifted in time and with fresh noise. Good for timing, not for counting verdicts."
        )
    with views.progress("simulating", valves) as advance:
        plant = write_archive(plan, folder, choose_executor(workers), advance)
    for path in (plant, folder / "truth.json"):
        views.out.print(views.escape(str(path)), highlight=False, soft_wrap=True)
    views.say_next(f"stemwatch screen --plant {plant}")
