"""A plant of CSV exports in a folder of its own, and a store with it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from stemwatch.service.config import Plant, load_plant
from stemwatch.service.store.store import Store, open_store

MakePlant = Callable[..., Plant]


@pytest.fixture
def make_plant(plant: Path) -> MakePlant:
    """Loads the small plant with more tables put in front of its own."""

    def make(more: str = "") -> Plant:
        text = plant.read_text(encoding="utf-8")
        service = "" if "[service]" in more else "[service]\nworkers = 1\n"
        plant.write_text(f"{service}{more}\n{text}", encoding="utf-8")
        loaded = load_plant(plant, environment={})
        assert loaded.problems == ()
        return loaded

    return make


@pytest.fixture
def plant_store(plant: Path) -> Iterator[Store]:
    """The store that the small plant's file names by default."""
    with open_store(f"sqlite:///{plant.parent / 'stemwatch.db'}") as store:
        yield store
