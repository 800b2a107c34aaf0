"""Samples in a hypertable, where the server of the tests has TimescaleDB.

Not marked ``postgres``: the extension cannot be installed everywhere that PostgreSQL can, and the
skip says so.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta

import pytest
from sqlalchemy import text

from stemwatch.service.store.samples import partitions
from stemwatch.service.store.samples.partitions import SampleLayout
from stemwatch.service.store.store import open_store
from tests.service.store.older_databases import database_at
from tests.service.store.samples.test_store_partitions import NOW, batch

DAY = timedelta(days=1)


def test_timescaledb_is_used_where_it_is_installed(new_database: Callable[[str], str]) -> None:
    """The whole path on a real hypertable, where the server has the extension."""
    url = new_database("postgresql")
    with database_at(url, "0004") as engine, engine.connect() as connection:
        there = "SELECT count(*) FROM pg_available_extensions WHERE name = 'timescaledb'"
        if not connection.execute(text(there)).scalar():
            pytest.skip("this PostgreSQL has no TimescaleDB: HYPERTABLES ARE NOT TESTED")
        connection.execute(text("CREATE EXTENSION timescaledb"))
        connection.commit()
    with open_store(url) as store:
        with store.transactions.reading() as session:
            assert partitions.layout_of(session.connection()) is SampleLayout.HYPERTABLE
        store.samples.write(batch(NOW - 5 * DAY, NOW))
        store.samples.write(batch(NOW - 5 * DAY, NOW, value=9.0))
        assert store.samples.read("plc", "OP").values.tolist() == [1.0, 1.0]
        assert store.samples.remove_before(NOW - 3 * DAY, whole_days=True) == 3
