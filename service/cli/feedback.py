"""``stemwatch feedback``: what people found at the valves, counted, and as labels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from stemwatch.service.cli.store_options import PlantOfStore, StoreUrl, named_store


def feedback(
    plant: PlantOfStore = None,
    db: StoreUrl = "",
    out: Annotated[Path | None, typer.Option(help="Write every label to this CSV file.")] = None,
) -> None:
    """Count what people said of the findings: right, wrong, partly right; export it as labels.

    Those who may record maintenance say it on the page of each valve.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.maintenance.labels import labels_csv
    from stemwatch.service.store.errors import StoreError
    from stemwatch.service.store.screenings.feedback import Judgement
    from stemwatch.service.store.store import open_existing_store

    address, _ = named_store(plant, db)
    with open_existing_store(address) as store:
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
