"""``stemwatch feedback``: what people found at the valves, counted, and as labels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stemwatch.service.cli import options as o


def feedback(
    plant: Annotated[Path | None, typer.Option(help="plant.toml, for its database.")] = None,
    db: Annotated[str, typer.Option(help="Database URL, instead of --plant.")] = "",
    out: Annotated[Path | None, typer.Option(help="Write every label to this CSV file.")] = None,
) -> None:
    """Count what people said of the findings: right, wrong, partly right; export it as labels.

    It is given on the page of each valve, by those who may record maintenance.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.config import load_plant
    from stemwatch.service.maintenance.labels import labels_csv
    from stemwatch.service.store.errors import StoreError
    from stemwatch.service.store.screenings.feedback import Judgement
    from stemwatch.service.store.store import open_existing_store

    if not db and plant is None:
        raise typer.BadParameter("give --plant plant.toml or --db URL")
    loaded = load_plant(o.need_file(plant, "--plant")) if plant is not None else None
    with open_existing_store(db or (loaded.storage if loaded else db)) as store:
        labels = store.feedback()
        if not labels and not store.valves():
            raise StoreError(f"{store.address}: no valve was screened into this database yet")
    counts = {
        judgement: sum(label.judgement is judgement for label in labels) for judgement in Judgement
    }
    count_list = ", ".join(f"{count} {word.value}" for word, count in counts.items())
    judged = "1 finding was" if len(labels) == 1 else f"{len(labels)} findings were"
    views.say_result(f"{judged} judged: {count_list}.")
    if out is not None:
        views.write_file(out, labels_csv(labels))
        views.say_result(f"Labels: {out.resolve()}")
    elif labels:
        views.say_next("the labels themselves, with --out labels.csv.")
    else:
        views.say_next("say on a valve's page, under Notes and work, what was found.")
