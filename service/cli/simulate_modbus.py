"""``stemwatch simulate --modbus``: a plant whose valves wear, behind a Modbus server."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from stemwatch.models.studies.simulator import PlantLoop
    from stemwatch.service.modbus_plant import PlantServer, Wear
    from stemwatch.service.store.store import Store

WEAR = re.compile(r"(?P<tag>.+)=(?P<S>\d+(?:\.\d+)?)(?:/(?P<J>\d+(?:\.\d+)?))?")
USUAL = "6/2.4"  # S and J in percent that the valve reaches by default
_SHOWN = 12  # loops of which the map is printed


def serve_modbus(
    loops: Sequence[PlantLoop],
    out: Path,
    *,
    host: str,
    port: int,
    speed: float,
    seed: int,
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
            views.out.print(f"and so on; {len(loops)} loops in all.", highlight=False)
        worn = ", ".join(wearing) or "none"
        for line in (
            f"Modbus on {server.host}:{server.port}, unit {server.unit_id}, for reading only",
            f"Plant file: {file}",
            f"Valves that wear: {worn}. Ctrl-C ends it.",
        ):
            views.out.print(views.escape(line), highlight=False, soft_wrap=True)

    views.say(f"Simulating {len(loops)} loops ...")
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
