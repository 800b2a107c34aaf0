"""A plant with its store, and a store on each engine; PostgreSQL of the store's own tests."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from stemwatch.service.config import Plant, load_plant
from stemwatch.service.store.store import Store, open_store
from tests.service.store.conftest import database_like
from tests.service.store.conftest import postgres_server as postgres_server
from tests.service.store.conftest import postgres_template as postgres_template
from tests.service.store.conftest import sqlite_template as sqlite_template
from tests.service.web.conftest import postgres_url as postgres_url


# Alerts ask the store, whose own tests run on both engines in every run.
@pytest.fixture(
    params=[
        "sqlite",
        pytest.param("postgresql", marks=[pytest.mark.postgres, pytest.mark.long]),
    ]
)
def either_store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Store]:
    """An empty store, on SQLite and on PostgreSQL."""
    if request.param == "sqlite":
        path = shutil.copy(request.getfixturevalue("sqlite_template"), tmp_path / "either.db")
        with open_store(f"sqlite:///{path}") as opened:
            yield opened
        return
    template = request.getfixturevalue("postgres_template")
    server = request.getfixturevalue("postgres_server")
    with database_like(template, server) as url, open_store(url) as opened:
        yield opened


def plant_of(text: str, folder: Path) -> Plant:
    """The plant of a plant file with this text, which must be without problems."""
    file = folder / "plant.toml"
    file.write_text(text, encoding="utf-8")
    loaded = load_plant(file, environment={})
    assert loaded.problems == ()
    return loaded


@pytest.fixture
def store(plant: Plant, sqlite_template: Path) -> Iterator[Store]:
    """The store of the test's plant."""
    shutil.copy(sqlite_template, plant.storage.reveal().removeprefix("sqlite:///"))
    with open_store(plant.storage) as opened:
        opened.save_valves(plant.valves.values())
        yield opened
