"""``stemwatch simulate``: recordings with known truth from the plant simulator, or a live plant."""

from __future__ import annotations

from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from stemwatch.models.studies.simulator import PlantLoop, SimulatedLoop

START = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
COUNT = 20  # random loops, where the user names no number
LIVE = "A live plant behind Modbus"

Modbus = Annotated[
    bool, typer.Option("--modbus", help="Serve the loops until Ctrl-C.", rich_help_panel=LIVE)
]
Host = Annotated[str, typer.Option(help="Address to listen on.", rich_help_panel=LIVE)]
Port = Annotated[
    int, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.", rich_help_panel=LIVE)
]
Speed = Annotated[
    float,
    typer.Option(
        min=0.1, max=10.0, help="Seconds of the plant in one of the clock.", rich_help_panel=LIVE
    ),
]
Wears = Annotated[
    list[str] | None,
    typer.Option(
        help="A valve that wears and the S and J it gets, percent: FIC-101=6/2.5.",
        rich_help_panel=LIVE,
    ),
]
WearOver = Annotated[
    float, typer.Option(min=1.0, help="Seconds of the plant it wears for.", rich_help_panel=LIVE)
]
Repairs = Annotated[
    str,
    typer.Option(
        help="Database of a service: a valve is as new once maintenance is recorded there.",
        rich_help_panel=LIVE,
    ),
]


class LoopKind(StrEnum):
    """The loops that ``simulate`` draws: those of the demonstration, or only one kind of valve."""

    DEMO = "demo"
    HEALTHY = "healthy"
    STICKY = "sticky"


def simulate(
    out: Annotated[Path, typer.Option(help="Folder to write into.")] = Path("simulated"),
    what: Annotated[
        LoopKind, typer.Option(help="The demo plant, or random healthy or sticking loops.")
    ] = LoopKind.DEMO,
    count: Annotated[
        int | None,
        typer.Option(min=1, max=10_000, help=f"How many random loops, by default {COUNT}."),
    ] = None,
    seed: o.Seed = 1,
    start: Annotated[str, typer.Option(help="Time of the first sample, ISO.")] = "",
    zone: Annotated[
        str, typer.Option(help="Time zone of --start and of the times that are written.")
    ] = "Europe/Berlin",
    modbus: Modbus = False,
    host: Host = "127.0.0.1",
    port: Port = 5020,
    speed: Speed = 1.0,
    wear: Wears = None,
    wear_over_s: WearOver = 3600.0,
    repairs: Repairs = "",
) -> None:
    """Write a historian export of simulated valves, its plant.toml, and the truth beside it.

    The simulator integrates the force balance of each valve at one millisecond inside a closed
    loop; it shares no code with the models that are fitted. truth.json is there to check
    the result: S, J, shape, whether the valve is healthy, and everything that was drawn.

    With --modbus the loops run on behind a Modbus server that only answers requests to read, and
    the plant.toml that reads them is written. The first valve wears unless --wear names others.
    """
    if count is not None and what is LoopKind.DEMO:
        raise typer.BadParameter(
            "the demo plant always has its fifteen loops; give --what healthy or --what sticky",
            param_hint="--count",
        )
    count = count or COUNT
    if modbus:
        from stemwatch.service.cli.simulate_modbus import serve_modbus

        serve_modbus(
            _loops(what, count, seed),
            out,
            host=host,
            port=port,
            speed=speed,
            seed=seed,
            wear=wear,
            wear_over_s=wear_over_s,
            repairs=repairs,
        )
        return
    _export(out, what, count, seed, start, zone)


def _export(out: Path, kind: LoopKind, count: int, seed: int, start: str, zone: str) -> None:
    from stemwatch.service.cli import views
    from stemwatch.service.studies.simulated_export import write_export

    begin = o.instant(start, zone, "--start") or START
    views.say(f"Simulating {kind.value} loops ...")
    written = write_export(simulated(kind, count, seed), out, start=begin, zone=zone)
    for path in (*written.files, written.plant_toml, written.truth_file):
        views.out.print(views.escape(str(path)), highlight=False, soft_wrap=True)
    views.say_next(f"stemwatch screen --plant {written.plant_toml}")


def simulated(kind: LoopKind, count: int, seed: int) -> list[SimulatedLoop]:
    """The loops, each with a seed of its own."""
    from stemwatch.models.studies.simulator import simulate_loop

    return [
        simulate_loop(loop, seed + index) for index, loop in enumerate(_loops(kind, count, seed))
    ]


def _loops(kind: LoopKind, count: int, seed: int) -> list[PlantLoop]:
    from stemwatch.models.studies.simulator import demo_plant, draw_healthy, draw_sticky

    if kind is LoopKind.DEMO:
        return demo_plant(seed)
    return draw_healthy(count, seed) if kind is LoopKind.HEALTHY else draw_sticky(count, seed)
