"""Upgrade and downgrade the schema of a database, with Alembic."""

from __future__ import annotations

from functools import cache
from typing import Any

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from alembic.util import CommandError
from sqlalchemy import Connection, Engine, text

from stemwatch.service.store.database.engine import for_writing, store_errors
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.samples.partitions import is_partition

_LOCK = 0x57E3_3A7C  # any number of our own: PostgreSQL's advisory lock for migrations


def upgrade(engine: Engine, address: DatabaseUrl) -> None:
    """Upgrade the database to the newest schema, keeping its data; one process at a time.

    Raises ``StoreError`` where the database cannot be reached, is not a database, or was written
    by a newer version of the program.
    """
    with store_errors(address, "opening the store"), for_writing(engine).begin() as connection:
        wait_for_others(connection)
        if (current := current_revision(connection)) is not None:
            refuse_newer(current, str(address))
        if current != newest_revision():
            command.upgrade(config_for(connection), "head")


def downgrade(engine: Engine, revision: str) -> None:
    """Return to schema ``revision``, or to no tables with ``"base"``; tables and columns that only
    newer schemas have are lost."""
    with for_writing(engine).begin() as connection:
        wait_for_others(connection)
        command.downgrade(config_for(connection), revision)


def take_back(engine: Engine, address: DatabaseUrl, revision: str) -> None:
    """``downgrade`` after a check: raises ``StoreError`` for an unknown schema, or one that is not
    older than the present one."""
    later_revisions = [walk_revision.revision for walk_revision in _migrations().walk_revisions()]
    if revision not in later_revisions:
        raise StoreError(
            f"{address}: there is no schema {revision}; {', '.join(reversed(later_revisions))}"
        )
    with store_errors(address, "reading the schema"), engine.connect() as connection:
        present = current_revision(connection)
    if present is not None:
        refuse_newer(present, str(address))
    if present is None or revision > present:
        raise StoreError(f"{address}: has schema {present or 'none'}, which is older already")
    with store_errors(address, "taking the schema back"):
        downgrade(engine, revision)


def is_compared(
    schema_item: Any, name: str | None, kind: str, reflected: bool, _other: Any
) -> bool:
    """Whether Alembic should compare this object with the tables in code (its ``include_object``).

    Not the partitions of samples, which are created at run time, nor the foreign keys of samples,
    which are not used on PostgreSQL.
    """
    if kind == "table":
        return not (reflected and is_partition(name or ""))
    return not (kind == "foreign_key_constraint" and schema_item.table.name == "samples")


def current_revision(connection: Connection) -> str | None:
    """The schema of the database, ``None`` where there is none yet."""
    return MigrationContext.configure(connection).get_current_revision()


def newest_revision() -> str:
    """The newest schema that this version of the program knows."""
    return str(_migrations().get_current_head())


def config_for(connection: Connection) -> Config:
    """Alembic's configuration with the connection that ``migrations/env.py`` uses."""
    config = _config()
    config.attributes["connection"] = connection
    return config


def wait_for_others(connection: Connection) -> None:
    """Lock out other processes that would change the schema, until the end of the transaction."""
    # On SQLite the transaction holds the write lock already.
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})


def is_newer(revision: str | None) -> bool:
    """Whether this version of the program does not know the schema, since a newer one made it."""
    if revision is None:
        return False
    try:
        _migrations().get_revision(revision)
    except CommandError:
        return True
    return False


def refuse_newer(revision: str, database: str) -> None:
    """Raise ``StoreError`` for a schema that this version of the program does not know."""
    if is_newer(revision):
        raise StoreError(
            f"{database}: written by a newer stemwatch (schema {revision}; this version knows "
            f"schemas up to {newest_revision()}). Install the newer version."
        )


@cache
def _migrations() -> ScriptDirectory:
    """All migrations, read once in a process: reading them takes longer than opening a store."""
    return ScriptDirectory.from_config(_config())


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", "stemwatch.service.store:migrations")
    return config
