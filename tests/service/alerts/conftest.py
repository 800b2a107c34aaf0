"""A store on each engine, and PostgreSQL's server of the store's own tests."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from stemwatch.service.store.store import Store, open_store
from tests.service.store.conftest import database_like
from tests.service.store.conftest import postgres_server as postgres_server
from tests.service.store.conftest import postgres_template as postgres_template
from tests.service.store.conftest import sqlite_template as sqlite_template
from tests.service.web.conftest import postgres_url as postgres_url


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)])
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
