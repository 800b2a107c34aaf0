"""``stemwatch demo``: the main job on a simulated plant, from nothing to a report."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from stemwatch.service.cli import options as o

ZONE = "Europe/Berlin"


def demo(
    out: Annotated[Path, typer.Option(help="Folder for everything the demo makes.")] = Path("demo"),
    seed: o.Seed = 1,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes.")] = None,
) -> None:
    """Simulate a small plant, screen its export into SQLite, and leave a report.

    Fifteen valves in closed loops: healthy ones, four shapes of stiction, a badly tuned loop, an
    oscillating disturbance, a quiet loop, and data that is bad in the usual ways.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.cli.screen import screen_plant
    from stemwatch.service.cli.simulate import START, What, simulated
    from stemwatch.service.export import write_export

    began = time.perf_counter()
    views.say("1/3  Simulating two hours of a plant with 15 valves ...")
    written = write_export(simulated(What.DEMO, 0, seed), out, start=START, zone=ZONE)
    views.say(f"     wrote {written.files[0]} and {written.plant_toml}")
    views.say("2/3  Screening the export ...")
    screen_plant(written.plant_toml, out / "report", workers)
    views.say(f"3/3  Done in {time.perf_counter() - began:.0f} s. Open the report in a browser.")
