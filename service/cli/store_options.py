"""The options by which a command names the store: a plant file, whose database it is, or a URL."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from stemwatch.service.config import Plant
    from stemwatch.service.store.database_url import DatabaseUrl

PlantOfStore = Annotated[Path | None, typer.Option(help="plant.toml, for its database.")]
StoreUrl = Annotated[str, typer.Option(help="Database URL, instead of --plant.")]


def named_store(plant: Path | None, db: str) -> tuple[DatabaseUrl | str, Plant | None]:
    """The store's address, ``db`` before that of the plant file; and the plant, where its file is
    given. Naming neither is wrong usage."""
    from stemwatch.service.config import load_plant

    if plant is None:
        if not db:
            raise typer.BadParameter("give --plant plant.toml or --db URL")
        return db, None
    loaded = load_plant(o.need_file(plant, "--plant"))
    return db or loaded.storage, loaded
