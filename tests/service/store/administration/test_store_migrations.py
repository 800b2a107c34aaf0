"""The schema: built by migrations alone, the same as the models, up and down without loss."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import Engine, inspect, text

from stemwatch.models.screening_result import Screening
from stemwatch.service.store.all_tables import metadata
from stemwatch.service.store.database.engine import make_engine
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.migrations.migrate import downgrade, is_compared, upgrade
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.samples.partitions import is_partition
from stemwatch.service.store.store import Store, open_store

NOW = datetime(2026, 3, 1, tzinfo=UTC)
TABLES = set(metadata.tables)


def tables(engine: Engine) -> set[str]:
    results = set(inspect(engine).get_table_names()) - {"alembic_version"}
    return {name for name in results if not is_partition(name)}


def test_migrations_and_models_agree(store_url: str) -> None:
    """What the migrations build is what the models describe, to the last index and constraint."""
    open_store(store_url).close()
    engine = make_engine(DatabaseUrl(store_url))
    with engine.connect() as connection:
        opts = {"compare_type": True, "include_object": is_compared}
        context = MigrationContext.configure(connection, opts=opts)
        assert [] == compare_metadata(context, metadata)
        indexes = inspect(connection).get_indexes("networks")
    engine.dispose()
    assert [("uq_networks_active", True)] == [
        (index["name"], bool(index["unique"])) for index in indexes
    ]


def test_a_store_that_is_up_to_date_is_opened_without_migrating(
    store_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its schema is the newest: Alembic, which takes longer than opening, is not asked."""
    open_store(store_url).close()
    monkeypatch.setattr(
        "alembic.command.upgrade", lambda *_, **__: pytest.fail("migrated once more")
    )
    open_store(store_url).close()


def test_downgrade_to_base_and_up_again(store_url: str) -> None:
    """Every migration can be undone and done again, leaving nothing behind and nothing out."""
    open_store(store_url).close()
    engine = make_engine(DatabaseUrl(store_url))
    assert TABLES == tables(engine)
    downgrade(engine, "base")
    assert set() == tables(engine)
    upgrade(engine, DatabaseUrl(store_url))
    assert TABLES == tables(engine)
    engine.dispose()


def test_one_step_down_and_up_keeps_what_older_schemas_know(
    store_url: str, make_screening: Callable[..., Screening]
) -> None:
    """A downgrade costs only what the older schema cannot hold; an upgrade costs nothing."""
    with open_store(store_url) as store:
        store.save(make_screening(), store.begin_run(software_version="1"))
        store.add_note("FIC-101", NOW, "gone with its table")
        before = (store.valves(), store.screenings("FIC-101"))
    engine = make_engine(DatabaseUrl(store_url))
    downgrade(engine, "0001")
    assert {"indicators", "runs", "screenings", "valves"} == tables(engine)
    engine.dispose()
    with open_store(store_url) as store:
        assert before == (store.valves(), store.screenings("FIC-101"))
        assert [] == store.notes("FIC-101")


def test_the_services_tables_go_and_come_without_touching_results(
    store_url: str, make_screening: Callable[..., Screening]
) -> None:
    """Back to the schema before the service and forward again: results and baselines stay, runs
    are over, and the queue works."""
    with open_store(store_url) as store:
        run = store.begin_run(software_version="1")
        store.save(make_screening(), run)
        store.finish_run(run)
        store.set_baseline("FIC-101", b"n", reason="first healthy window")
        store.queue.put(RunToQueue(schedule="daily", due=NOW), software_version="1")
        before = (store.screenings("FIC-101"), store.baseline("FIC-101"), store.run(run))
    engine = make_engine(DatabaseUrl(store_url))
    downgrade(engine, "0002")
    assert "samples" not in tables(engine)
    with engine.connect() as connection:
        assert connection.execute(text("SELECT count(*) FROM screenings")).scalar() == 1
    engine.dispose()
    with open_store(store_url) as store:
        assert before == (store.screenings("FIC-101"), store.baseline("FIC-101"), store.run(run))
        # What waited in the queue is a run that is over: the older program knows nothing else.
        assert store.queue.claim("w") is None


def test_opening_again_keeps_everything(
    store: Store, store_url: str, make_screening: Callable[..., Screening]
) -> None:
    """Opening a store that is up to date changes nothing in it."""
    store.save(make_screening(), store.begin_run(software_version="1"))
    with open_store(store_url) as repeated:
        assert store.valves() == repeated.valves()
        assert store.screenings("FIC-101") == repeated.screenings("FIC-101")


def test_a_newer_schema_is_refused(store: Store, store_url: str) -> None:
    """An old program leaves a new program's store alone and names both schemas."""
    engine = make_engine(DatabaseUrl(store_url))
    with engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    engine.dispose()
    with pytest.raises(
        StoreError, match=r"newer stemwatch \(schema 9999; .* up to 0013\)\. Install the newer"
    ):
        open_store(store_url)


def test_one_active_network_is_the_databases_own_rule(store: Store, store_url: str) -> None:
    """Even a writer that knows nothing of the store cannot make two baselines active."""
    store.set_baseline("FIC-101", b"n", reason="first healthy window")
    engine = make_engine(DatabaseUrl(store_url))
    copy = text(
        "INSERT INTO networks (id, valve, kind, network, created, reason, active) "
        "SELECT 99, valve, kind, network, created, reason, active FROM networks"
    )
    with pytest.raises(Exception, match=r"(?i)unique"), engine.begin() as connection:
        connection.execute(copy)
    engine.dispose()
