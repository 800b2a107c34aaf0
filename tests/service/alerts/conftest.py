"""A store on each engine, and PostgreSQL's server of the store's own tests."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from stemwatch.service.store.store import Store, open_store
from tests.service.store.conftest import postgres_server as postgres_server
from tests.service.web.conftest import postgres_url as postgres_url


@pytest.fixture(params=["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)])
def either_store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Store]:
    """An empty store, on SQLite and on PostgreSQL."""
    sqlite = request.param == "sqlite"
    url = (
        f"sqlite:///{tmp_path / 'either.db'}" if sqlite else request.getfixturevalue("postgres_url")
    )
    with open_store(url) as opened:
        yield opened
