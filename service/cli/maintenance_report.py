"""``stemwatch maintenance-report``: pages and work orders from what is stored."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.store_options import named_store

_SHOWN = 10  # valves left out that are named


def maintenance_report(
    plant: Annotated[
        Path | None, typer.Option(help="plant.toml, for its database, strokes and samples.")
    ] = None,
    db: Annotated[str, typer.Option(help="Database URL, instead of the plant's.")] = "",
    run: Annotated[
        int | None,
        typer.Option(min=1, help="Number of the run; else each valve's latest screening."),
    ] = None,
    valve: Annotated[
        list[str] | None, typer.Option(help="A valve's id; may be given several times.")
    ] = None,
    everything: Annotated[
        bool, typer.Option("--all", help="A page for each valve, healthy ones too.")
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder of the report.")] = Path(
        "stemwatch-maintenance"
    ),
    zone: Annotated[
        str, typer.Option(help="Time zone in which times are shown; else the plant's.")
    ] = "",
    site: o.Site = None,
    area: o.Area = None,
    unit: o.Unit = None,
) -> None:
    """Write a page for each valve that needs work, and work orders for a maintenance system.

    The pages come as HTML and PDF, in the order of their priority, with what was found, what to
    check in which order, parts and isolation hints; the work orders as XLSX and CSV.
    """
    from stemwatch.models.words import listed
    from stemwatch.service.cli import views
    from stemwatch.service.cli.reading import part_of
    from stemwatch.service.maintenance.stored import report_of_store
    from stemwatch.service.store.store import open_existing_store

    address, loaded = named_store(plant, db)
    with open_existing_store(address) as store:
        files = report_of_store(
            store,
            out,
            plant=loaded,
            run=run,
            valves=valve or (),
            part=part_of(site, area, unit),
            zone=zone,
            all_valves=everything,
        )
    views.out.print(files.work_list.counts, highlight=False)
    if files.left_out:
        views.say(
            f"left out: {listed(files.left_out, _SHOWN)}: the plant file does not name them any "
            "more; --valve asks for one"
        )
    for path in (files.pdf, files.html, files.xlsx, files.csv):
        views.out.print(views.escape(str(path.resolve())), highlight=False, soft_wrap=True)
    views.say_next(
        "hand out the PDF and import the work orders; say on each valve's page what was found."
    )
