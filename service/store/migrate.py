"""Bringing a database to the schema this version writes, with Alembic."""

from __future__ import annotations

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from alembic.util import CommandError
from sqlalchemy import Connection, Engine, text

from stemwatch.service.store.address import Address
from stemwatch.service.store.engine import for_writing, store_errors
from stemwatch.service.store.errors import StoreError

_LOCK = 0x57E3_3A7C  # any number of our own: PostgreSQL's advisory lock for migrations


def upgrade(engine: Engine, address: Address) -> None:
    """Bring the database to the newest schema, keeping what is in it; one process at a time.

    Raises ``StoreError`` when the database cannot be reached, is not one, or was written by a
    newer version of the program.
    """
    with store_errors(address, "opening the store"), for_writing(engine).begin() as connection:
        _wait_for_others(connection)
        _refuse_newer(connection, address)
        command.upgrade(config_for(connection), "head")


def downgrade(engine: Engine, revision: str) -> None:
    """Back to ``revision``, or to nothing with ``"base"``; what only newer schemas hold is lost."""
    with for_writing(engine).begin() as connection:
        _wait_for_others(connection)
        command.downgrade(config_for(connection), revision)


def config_for(connection: Connection) -> Config:
    """Alembic's settings for one open connection; ``migrations/env.py`` takes it from here."""
    config = Config()
    config.set_main_option("script_location", "stemwatch.service.store:migrations")
    config.attributes["connection"] = connection
    return config


def _wait_for_others(connection: Connection) -> None:
    # SQLite's write lock is held already.
    if connection.dialect.name == "postgresql":
        connection.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})


def _refuse_newer(connection: Connection, address: Address) -> None:
    current = MigrationContext.configure(connection).get_current_revision()
    script = ScriptDirectory.from_config(config_for(connection))
    if current is None:
        return
    try:
        script.get_revision(current)
    except CommandError:
        raise StoreError(
            f"{address}: written by a newer stemwatch (schema {current}; this version knows "
            f"schemas up to {script.get_current_head()}). Install the newer version."
        ) from None
