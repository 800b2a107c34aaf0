"""``stemwatch simulate``: recordings with known truth from the plant simulator, or a live plant."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Awaitable, Callable, Sequence
from datetime import UTC, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.models.words import counted
from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from rich.table import Table

    from stemwatch.models.studies.simulator import PlantLoop, SimulatedLoop
    from stemwatch.service.modbus_plant import PlantServer, Wear
    from stemwatch.service.store.store import Store

START = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
COUNT = 20  # random loops, where the user names no number
LIVE = "A live plant behind Modbus"
WEAR = re.compile(r"(?P<tag>.+)=(?P<S>\d+(?:\.\d+)?)(?:/(?P<J>\d+(?:\.\d+)?))?")
USUAL = "6/2.4"  # S and J in percent that the valve reaches by default
# Parameters that only the live plant has.
OF_THE_SERVER = ("host", "port", "speed", "wear", "wear_over_s", "repairs")
_SHOWN = 12  # loops of which the map is printed

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
    context: typer.Context,
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
    if modbus:
        o.refuse(context, ("start",), "the live plant begins now")
    else:
        o.refuse(context, OF_THE_SERVER, "without --modbus nothing is served")
    if count is not None and what is LoopKind.DEMO:
        raise typer.BadParameter(
            "the demo plant always has its fifteen loops; give --what healthy or --what sticky",
            param_hint="--count",
        )
    count = count or COUNT
    if modbus:
        _serve_modbus(
            _loops(what, count, seed),
            out,
            host=host,
            port=port,
            speed=speed,
            seed=seed,
            zone=o.zone_of(zone).key,
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


def _serve_modbus(
    loops: Sequence[PlantLoop],
    out: Path,
    *,
    host: str,
    port: int,
    speed: float,
    seed: int,
    zone: str,
    wear: Sequence[str] | None,
    wear_over_s: float,
    repairs: str,
) -> None:
    """Serve ``loops`` until Ctrl-C or SIGTERM, with ``plant.toml`` in ``out``."""
    from stemwatch.service.cli import views
    from stemwatch.service.modbus_plant import serve_plant
    from stemwatch.service.store.store import open_store

    wearing = wear_of(loops, wear, wear_over_s)

    def ready(server: PlantServer, file: Path) -> None:
        views.out.print(map_table(loops))
        if len(loops) > _SHOWN:
            views.out.print(f"and so on; {counted(len(loops), 'loop')} in all.", highlight=False)
        worn = ", ".join(wearing) or "none"
        for line in (
            f"Modbus on {server.host}:{server.port}, unit {server.unit_id}, for reading only",
            f"Plant file: {file}",
            f"Valves that wear: {worn}. Ctrl-C ends it.",
        ):
            views.out.print(views.escape(line), highlight=False, soft_wrap=True)

    views.say(f"Simulating {counted(len(loops), 'loop')} ...")
    with contextlib.ExitStack() as stack:
        repairing = None
        if repairs:
            repairing = _repairing(stack.enter_context(open_store(repairs)), loops)
        serve_plant(
            loops,
            out,
            host,
            port,
            speed=speed,
            every_s=round(1.0 / speed, 3),
            zone=zone,
            wear=wearing,
            seed=seed,
            ready=ready,
            beside_serving=repairing,
        )


def _repairing(
    store: Store, loops: Sequence[PlantLoop]
) -> Callable[[PlantServer], Awaitable[object]]:
    """A function that repairs the valves whose maintenance is recorded in ``store`` from now on."""
    from stemwatch.service.cli import views
    from stemwatch.service.live_demo import RecordedMaintenance, repair_recorded_valves

    def note_repair(tag: str) -> None:
        views.out.print(views.escape(f"{tag} was repaired and is as new."), highlight=False)

    maintenance = RecordedMaintenance(store, [loop.tag for loop in loops])
    return lambda server: repair_recorded_valves(maintenance, server, note_repair)


def wear_of(
    loops: Sequence[PlantLoop], declared: Sequence[str] | None, over_s: float
) -> dict[str, Wear]:
    """Which valves wear and how, from ``TAG=S`` or ``TAG=S/J``; by default the first one, with
    ``none`` no valve. Raises ``typer.BadParameter``."""
    from stemwatch.service.modbus_plant import Wear

    if declared and "none" in declared:
        return {}
    tags = [loop.tag for loop in loops]
    wears: dict[str, Wear] = {}
    for text in declared or [f"{tags[0]}={USUAL}"]:
        read = WEAR.fullmatch(text)
        if read is None:
            raise typer.BadParameter(
                f"{text!r} is not understood; expected TAG=S or TAG=S/J in percent of span, such "
                f"as {tags[0]}={USUAL}, or none",
                param_hint="--wear",
            )
        if read["tag"] not in tags:
            raise typer.BadParameter(
                f"no loop {read['tag']} in this plant; it has {', '.join(tags[:_SHOWN])}",
                param_hint="--wear",
            )
        try:
            wears[read["tag"]] = Wear(
                S_percent=float(read["S"]), J_percent=float(read["J"] or 0.0), over_s=over_s
            )
        except ValueError as error:
            raise typer.BadParameter(str(error), param_hint="--wear") from error
    return wears


def map_table(loops: Sequence[PlantLoop]) -> Table:
    """Which register holds which signal, of the first loops."""
    from rich.table import Table

    from stemwatch.service.modbus_plant.register_layout import registers

    table = Table("tag", "holding register", "as manuals print it", "type", "unit")
    for line in registers(loops[:_SHOWN]):
        table.add_row(line.tag, str(line.address), f"{40_001 + line.address}", line.kind, line.unit)
    return table
