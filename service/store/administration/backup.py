"""Back up, restore and copy a database: a consistent snapshot, and all of it or nothing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Connection, Engine

from stemwatch.service.store.administration.backup_file import (
    LiveDatabase,
    TableDigest,
    reading_archive,
    write_archive,
)
from stemwatch.service.store.administration.fill import fill
from stemwatch.service.store.database.engine import existing_engine, make_engine, store_errors
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError


def backup(address: DatabaseUrl, path: Path) -> dict[str, TableDigest]:
    """Write the whole database to the archive ``path``; return rows and digest of each table.

    Others may write meanwhile: the archive is a snapshot. Raises ``StoreError`` for a database
    that does not exist or has no tables of stemwatch, and where the file exists already.
    """
    with disposing(existing_engine(address)) as engine, one_instant(engine, address) as connection:
        source = LiveDatabase(connection)
        if source.schema.revision is None:
            raise StoreError(f"{address}: has no tables of stemwatch: there is nothing to back up")
        return write_archive(source, path, str(address))


def restore(path: Path, address: DatabaseUrl) -> dict[str, TableDigest]:
    """Restore the archive ``path`` into an empty database and upgrade its schema.

    Raises ``StoreError`` for a database that is not empty, and for a file that is not a backup or
    is damaged; the database is then unchanged.
    """
    with reading_archive(path) as source, disposing(make_engine(address)) as engine:
        return fill(engine, address, source)


def copy(origin: DatabaseUrl, target: DatabaseUrl) -> dict[str, TableDigest]:
    """Copy ``origin`` into the empty database ``target`` and upgrade the schema of ``target``.

    ``origin`` is not changed. Raises ``StoreError`` as ``backup`` and ``restore`` do.
    """
    if origin == target:
        raise StoreError(f"{origin}: is the database itself; give another one to copy to")
    with (
        disposing(existing_engine(origin)) as origin_engine,
        one_instant(origin_engine, origin) as connection,
        disposing(make_engine(target)) as engine,
    ):
        return fill(engine, target, LiveDatabase(connection))


@contextmanager
def disposing(engine: Engine) -> Iterator[Engine]:
    """The engine; its connections are closed at the end of the block."""
    try:
        yield engine
    finally:
        engine.dispose()


@contextmanager
def one_instant(engine: Engine, address: DatabaseUrl) -> Iterator[Connection]:
    """A read-only connection that sees a consistent snapshot of the database."""
    with store_errors(address, "reading the store"), engine.connect() as connection:
        if engine.dialect.name == "postgresql":
            connection = connection.execution_options(
                isolation_level="REPEATABLE READ", postgresql_readonly=True
            )
        with connection.begin():
            yield connection
