"""``stemwatch maintenance``: note work on a valve, so that it gets a new baseline."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Annotated

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.store_options import PlantOfStore, StoreUrl, named_store


def maintenance(
    valve: Annotated[str, typer.Argument(help="The valve's id.")],
    note: Annotated[str, typer.Option(help="What was done: 'packing renewed'.")],
    plant: PlantOfStore = None,
    db: StoreUrl = "",
    at: Annotated[str, typer.Option(help="When, ISO time; now where left out.")] = "",
    who: Annotated[str, typer.Option(help="Who did it.")] = "",
    zone: Annotated[
        str, typer.Option(help="Time zone of --at without offset; else the plant's.")
    ] = "",
) -> None:
    """Record maintenance of a valve.

    From then on its baseline counts as one from before the work, and the first window that begins
    after it becomes the new baseline.
    """
    from stemwatch.connectors.connector import nearest_names
    from stemwatch.service.cli import views
    from stemwatch.service.presenter.wording import after_work
    from stemwatch.service.presenter.work_decision import NO_POSITION, obstacle_kind
    from stemwatch.service.store.screenings.records import no_time_of_a_plant, not_done_yet
    from stemwatch.service.store.store import open_existing_store, open_store

    address, loaded = named_store(plant, db)
    home = zone or (loaded.zone if loaded else None) or ""
    moment = o.instant(at, home, "--at") or datetime.now(UTC)
    if reason := no_time_of_a_plant(moment) or not_done_yet(moment, datetime.now(UTC)):
        raise typer.BadParameter(reason, param_hint="--at")
    # A plant file names its valves before any run; without one the database may be mistyped.
    opened = open_existing_store(address) if db else open_store(address)
    with opened as store:
        names = {stored_valve.id for stored_valve in store.valves()}
        names |= set(loaded.valves if loaded else ())
        if valve not in names:
            raise typer.BadParameter(
                f"there is no valve {valve!r} in this store; nearest: "
                f"{nearest_names(valve, sorted(names)) or 'none'}",
                param_hint="VALVE",
            )
        store.record_maintenance(valve, moment, note, who)
        if loaded and valve in loaded.valves:
            has_position = loaded.valves[valve].tags.mv is not None
        else:
            newest = store.screenings(valve, 1)
            has_position = not newest or obstacle_kind(newest[0].no_verdict) != NO_POSITION
    at_minute = moment.isoformat(timespec="minutes")
    line = views.escape(f"Recorded for {valve} at {at_minute}: {note}")
    views.out.print(line, highlight=False)
    views.say(after_work(has_position))
    views.say_next("screen a window after the work.")
