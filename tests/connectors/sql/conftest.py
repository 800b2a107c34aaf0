"""The same history in a SQLite file and in a PostgreSQL database of its own."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

import pytest
from sqlalchemy import create_engine, text

from stemwatch.connectors.secret import Secret
from stemwatch.connectors.sql import SqlAddress
from tests.connectors import example_archives as made
from tests.service.store.conftest import database_like
from tests.service.store.conftest import postgres_server as postgres_server

QUERY = (
    "SELECT time, value, quality FROM history "
    "WHERE tag = :tag AND time >= :start AND time < :end ORDER BY time"
)
TAGS = "SELECT tag, COUNT(value) AS samples FROM history GROUP BY tag ORDER BY tag"


def fill(url: str, kind: str = "") -> None:
    """A table ``history`` with the recording; times are text in SQLite, instants in PostgreSQL, or
    of the ``kind`` that is given, without their zone."""
    engine = create_engine(url)
    sqlite = engine.dialect.name == "sqlite"
    local = bool(kind)
    kind = kind or ("text" if sqlite else "timestamptz")

    def written(time: datetime) -> str | datetime:
        if sqlite:
            return time.replace(tzinfo=None).isoformat(sep=" ")
        return time.replace(tzinfo=None) if local else time

    rows = [
        {"tag": tag, "time": written(time), "value": value, "quality": quality}
        for tag, time, value, quality in made.narrow_rows()
    ]
    with engine.begin() as connection:
        connection.execute(
            text(f"CREATE TABLE history (tag text, time {kind}, value float, quality text)")
        )
        into = "INSERT INTO history VALUES (:tag, :time, :value, :quality)"
        connection.execute(text(into), rows)
    engine.dispose()


def address(at: str, **other) -> SqlAddress:
    """The history, as a plant file would describe it."""
    from stemwatch.connectors.historian import ReadOptions

    given = {
        "name": "historian",
        "query": QUERY,
        "tags_query": TAGS,
        "options": ReadOptions(zone="UTC"),
    }
    return SqlAddress(**({"url": Secret(text=at)} | given | other))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Each test that asks for ``history_url`` runs on both engines."""
    if "history_url" in metafunc.fixturenames:
        engines = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
        metafunc.parametrize("history_url", engines, indirect=True)


@pytest.fixture
def history_url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """The URL of a database with the recording in it."""
    if request.param == "sqlite":
        url = f"sqlite:///{tmp_path / 'history.db'}"
        fill(url)
        yield url
        return
    url = request.getfixturevalue("empty_postgres")
    fill(url)
    yield url


@pytest.fixture
def empty_postgres(postgres_server: str) -> Iterator[str]:
    """The URL of an empty PostgreSQL database."""
    with database_like("template1", postgres_server) as url:
        yield url
