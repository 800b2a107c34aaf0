"""Samples on PostgreSQL: a partition for each day, made ahead, dropped whole, none ever needed."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from sqlalchemy import text

from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.migrations.versions import v0005_production
from stemwatch.service.store.samples import partitions
from stemwatch.service.store.samples.partitions import DAY_US, DAYS_AHEAD, SampleLayout
from stemwatch.service.store.samples.tables import microseconds
from stemwatch.service.store.store import Store, open_store
from tests.service.store.older_databases import database_at

NOW = datetime.now(UTC).replace(hour=12, minute=0, second=0, microsecond=0)
DAY = timedelta(days=1)
LONG_AGO = datetime(1999, 1, 1, tzinfo=UTC)


@pytest.fixture
def site(new_database: Callable[[str], str]) -> Iterator[Store]:
    """An empty store in PostgreSQL."""
    with open_store(new_database("postgresql")) as store:
        yield store


pytestmark = pytest.mark.postgres


def batch(*instants: datetime, value: float = 1.0, tag: str = "OP") -> SampleBatch:
    """One sample of ``tag`` at each instant."""
    count = len(instants)
    return SampleBatch(
        source="plc",
        tags=(tag,) * count,
        at_us=np.array([microseconds(instant) for instant in instants], np.int64),
        values=np.full(count, value),
        quality=np.zeros(count, np.uint8),
        reasons=("",) * count,
    )


def rows_in(store: Store, table: str) -> int:
    with store.transactions.reading() as session:
        return session.execute(text(f"SELECT count(*) FROM {table}")).scalar_one()


def days_of(store: Store) -> set[int]:
    with store.transactions.reading() as session:
        return set(partitions.existing_days(session.connection()))


def test_days_are_made_ahead(site: Store) -> None:
    """The first sample of a day finds its partition, and those of the coming week."""
    site.samples.write(batch(NOW))
    today = partitions.day_of(NOW)
    assert set(range(today, today + DAYS_AHEAD + 1)) <= days_of(site)
    assert rows_in(site, partitions.partition_name(today)) == 1
    with site.transactions.reading() as session:
        assert partitions.layout_of(session.connection()) is SampleLayout.PARTITIONS


def test_a_sample_without_a_day_is_not_lost(site: Store) -> None:
    """A wrong clock or an old export makes no tables: such samples lie in the default one."""
    ahead = NOW + 3650 * DAY
    site.samples.write(batch(LONG_AGO, NOW - 2 * DAY, ahead))
    assert rows_in(site, partitions.DEFAULT) == 2
    assert site.samples.read("plc", "OP").at_us.size == 3
    assert partitions.day_of(NOW - 2 * DAY) in days_of(site)
    assert site.samples.bounds("plc", "OP") == (LONG_AGO, ahead)


def test_a_sample_is_kept_once_wherever_it_lies(site: Store) -> None:
    """The key holds within days, in the default partition, and after a row has moved."""
    for _ in range(2):
        site.samples.write(batch(LONG_AGO, NOW))
    site.samples.write(batch(LONG_AGO, NOW, value=9.0))
    assert site.samples.read("plc", "OP").values.tolist() == [1.0, 1.0]
    day = partitions.day_of(LONG_AGO)
    with site.transactions.writing("moving a day") as session:
        assert partitions.make_days(session.connection(), {day}) == 1
    assert (rows_in(site, partitions.DEFAULT), rows_in(site, "samples_19990101")) == (0, 1)
    site.samples.write(batch(LONG_AGO, value=9.0))
    assert site.samples.read("plc", "OP").values.tolist() == [1.0, 1.0]
    with (
        pytest.raises(StoreError, match="duplicate key"),
        site.transactions.writing("twice") as session,
    ):
        session.execute(text("INSERT INTO samples_19990101 SELECT * FROM samples_19990101"))


def test_days_over_age_are_dropped_whole(site: Store) -> None:
    """Tables of days that are wholly older go, strays too; the day of the instant stays."""
    old = [NOW - 5 * DAY, NOW - 3 * DAY, NOW - 3 * DAY - timedelta(hours=1)]
    site.samples.write(batch(LONG_AGO, *old, NOW))
    assert site.samples.remove_before(NOW - 3 * DAY, whole_days=True) == 2
    assert site.samples.read("plc", "OP").at_us.tolist() == sorted(
        microseconds(item) for item in (*old[1:], NOW)
    )
    assert partitions.day_of(NOW - 5 * DAY) not in days_of(site)
    assert site.samples.remove_before(NOW - 3 * DAY) == 1
    site.samples.write(batch(NOW - 5 * DAY))  # a day that was dropped may come back
    assert site.samples.read("plc", "OP").at_us.size == 3


def test_writers_that_need_the_same_new_days_do_not_hinder_each_other(site: Store) -> None:
    """Several processes that see a day for the first time make it once and lose nothing."""
    stores = [open_store(site.address) for _ in range(3)]
    errors: list[BaseException] = []

    def write(store: Store, tag: str) -> None:
        try:
            for day in range(4):
                store.samples.write(batch(NOW - day * DAY, tag=tag))
                store.samples.write(batch(NOW - day * DAY, tag="shared"))
        except BaseException as error:
            errors.append(error)

    threads = [
        threading.Thread(target=write, args=(store, f"T{n}")) for n, store in enumerate(stores)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for store in stores:
        store.close()
    assert errors == []
    assert rows_in(site, "samples") == 16
    assert rows_in(site, partitions.DEFAULT) == 0


def test_a_day_that_cannot_be_made_costs_no_sample(
    site: Store, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """While somebody holds the table, samples go into the default partition, with a warning."""
    monkeypatch.setattr(partitions, "_LOCK_WAIT", "50ms")
    with site.transactions.readers.connect() as reader:
        reader.execute(text("SELECT count(*) FROM samples"))
        site.samples.write(batch(NOW))
    assert rows_in(site, partitions.DEFAULT) == 1
    assert "default partition for now" in caplog.text
    monkeypatch.undo()  # nobody holds the table any more; a busy machine may still be slow
    site.samples.remove_before(LONG_AGO)  # the duty that runs now and then
    assert rows_in(site, partitions.DEFAULT) == 0


def test_an_upgrade_sorts_what_is_there_into_days(new_database: Callable[[str], str]) -> None:
    """Samples of a plain table find their partitions, those of long ago the default one."""
    url = new_database("postgresql")
    fresh = microseconds(NOW - 9 * DAY)
    with database_at(url, "0004") as engine, engine.begin() as connection:
        connection.execute(text("UPDATE samples SET at_us = 5 WHERE tag_id = 1"))
        connection.execute(text(f"UPDATE samples SET at_us = {fresh} WHERE tag_id = 2"))
    with open_store(url) as store:
        assert rows_in(store, partitions.DEFAULT) == 1
        assert rows_in(store, partitions.partition_name(fresh // DAY_US)) == 1


def test_what_timescaledb_is_told() -> None:
    """The statements for a hypertable: a day to a chunk, compressed by tag after a week, dropped
    by the same instant. The extension itself is not on this machine."""
    create, now, use_now = v0005_production.HYPERTABLE
    assert "create_hypertable('samples', 'at_us'" in create
    assert f"BIGINT '{DAY_US}'" in create
    assert "RETURNS bigint" in now
    assert "'stemwatch_now_us'" in use_now
    settings, policy = v0005_production.COMPRESSION
    assert "compress_segmentby = 'tag_id'" in settings
    assert policy.endswith(f"BIGINT '{7 * DAY_US}')")
    assert partitions.drop_chunks(7) == "SELECT drop_chunks('samples', older_than => BIGINT '7')"
