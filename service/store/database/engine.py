"""SQLAlchemy engines for SQLite (in WAL mode) and PostgreSQL, and their errors as sentences."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from json import JSONDecodeError
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import (
    ArgumentError,
    DataError,
    DBAPIError,
    NoSuchModuleError,
    SQLAlchemyError,
)

from stemwatch.connectors.secret import masked
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError, Unstorable

BUSY_TIMEOUT_MS = 30_000
_WRITES = "stemwatch_writes"
# Messages of SQLite; the last two where bytes of a text or of its own schema are no longer valid
# text.
_DAMAGED = (
    "malformed", "is not a database", "file is encrypted", "database corruption", "disk I/O error",
    "Could not decode", "unsupported file format",
)  # fmt: skip
# An @, / or # between the colon after the user and the last @: the password would end there, and
# the rest be taken for the host.
_PASSWORD_CUT = re.compile(r"^[\w+]+://[^:@/?\s]*:[^?]*[@/#][^?]*@")
_OWN = 0o600  # it holds digests of passwords


def make_engine(address: DatabaseUrl, *, synced: bool = False) -> Engine:
    """An engine for ``address``, not connected yet. Raises ``StoreError`` for a malformed URL,
    another kind of database, or a driver that is not installed.

    ``synced``: what is committed to SQLite is on the disk when the commit returns, as it always is
    in PostgreSQL.
    """
    backend = _backend(address)
    if backend != "sqlite" and _PASSWORD_CUT.search(address.reveal()):
        raise StoreError(
            f"{address}: the password has letters that a URL must write otherwise: %40 for @, %2F "
            "for /, %23 for #, %3F for ?. Or leave it out of the URL and put it into PGPASSWORD"
        )
    try:
        engine = create_engine(_with_driver(address.reveal()), hide_parameters=True)
    except (ImportError, NoSuchModuleError) as error:
        raise StoreError(
            f"{address}: no driver for this database ({error}); SQLite needs none, PostgreSQL "
            "needs the package psycopg"
        ) from None
    if backend == "sqlite":
        event.listen(engine, "do_connect", lambda *_: _make_private(engine.url.database))
        event.listen(engine, "connect", _prepare_sqlite)
        if synced:
            event.listen(engine, "connect", _sync_each_commit)
        event.listen(engine, "begin", _begin_sqlite)
    return engine


def existing_engine(address: DatabaseUrl) -> Engine:
    """An engine for an existing database. Raises ``StoreError`` where a SQLite file does not
    exist, because connecting would create an empty one."""
    engine = make_engine(address)
    file = _file_of(engine)
    if file is not None and not file.is_file():
        raise StoreError(
            f"{address}: there is no database at {file.absolute()}; `stemwatch screen` and "
            "`stemwatch serve` make one"
        )
    return engine


def _file_of(engine: Engine) -> Path | None:
    file = engine.url.database
    is_file = engine.dialect.name == "sqlite" and file and file != ":memory:"
    return Path(file) if is_file and file else None


def sqlite_files(address: DatabaseUrl) -> tuple[Path, ...]:
    """The files that a SQLite database has, with those that it has only while it is used; none of
    a database elsewhere. Raises ``StoreError`` for a malformed URL."""
    file = _file_of(make_engine(address))
    if file is None:
        return ()
    return (file, *(file.with_name(file.name + end) for end in ("-wal", "-shm", "-journal")))


def for_writing(engine: Engine) -> Engine:
    """The same engine and pool, whose transactions take SQLite's write lock when they begin.

    A transaction that first reads and then writes would otherwise fail at once, without waiting,
    when another has written in between.
    """
    return engine.execution_options(**{_WRITES: True})


@contextmanager
def store_errors(address: DatabaseUrl, doing: str) -> Iterator[None]:
    """Turn database errors into a ``StoreError`` that names the database and what was being done,
    without the password; into an ``Unstorable`` where trying again would not help."""
    try:
        yield
    except SQLAlchemyError as error:
        message = f"{doing} failed: {error_text(error, address)}"
        kind = Unstorable if isinstance(error, DataError) else StoreError
        raise kind(f"{address}: {message}{_if_damaged(error, message, address)}") from None
    except (UnicodeDecodeError, JSONDecodeError) as error:  # a row does not hold what was saved
        message = f"{doing} failed: {error}"
        raise StoreError(f"{address}: {message}{_if_damaged(error, message, address)}") from None


def _if_damaged(error: Exception, message: str, address: DatabaseUrl) -> str:
    """What to do where a SQLite file is damaged; empty for other errors."""
    cause = getattr(error, "orig", None) or error
    broken = isinstance(cause, ValueError) or any(words in message for words in _DAMAGED)
    if not broken or not address.reveal().startswith("sqlite"):
        return ""
    return (
        ". The file is damaged, or no database of stemwatch: stop the service, put the file aside "
        "with its -wal and -shm, and bring the newest backup back with stemwatch db restore; "
        "stemwatch db check tells whether a database is whole"
    )


@contextmanager
def driver_errors(connection: Connection) -> Iterator[None]:
    """Turn errors of the driver, which COPY uses directly, into SQLAlchemy's ``DBAPIError``."""
    driver = connection.dialect.loaded_dbapi
    try:
        yield
    except driver.Error as error:
        lost = connection.dialect.is_disconnect(error, None, None)
        if lost:
            connection.invalidate(error)
        raise DBAPIError.instance(
            "COPY",
            None,
            error,
            driver.Error,
            hide_parameters=True,
            connection_invalidated=lost,
            dialect=connection.dialect,
        ) from error


def error_text(error: BaseException, address: DatabaseUrl) -> str:
    """The database's error message on one line, without the password."""
    cause = getattr(error, "orig", None) or error
    words = masked(" ".join(str(cause).split())) or type(cause).__name__
    password = _password(address)
    return words.replace(password, "***") if password else words


def _password(address: DatabaseUrl) -> str | None:
    try:
        return make_url(address.reveal()).password
    except (ArgumentError, ValueError):
        return None


def _backend(address: DatabaseUrl) -> str:
    try:
        backend = make_url(_with_driver(address.reveal())).get_backend_name()
    except (ArgumentError, ValueError):
        raise StoreError(
            f"{address}: not a database URL; expected sqlite:///file.db or "
            "postgresql://user:password@host/database"
        ) from None
    if backend not in ("sqlite", "postgresql"):
        raise StoreError(f"{address}: the store needs SQLite or PostgreSQL, received {backend}")
    return backend


def _with_driver(url: str) -> str:
    """The URL with psycopg 3 named as driver, whatever SQLAlchemy's default is."""
    for scheme in ("postgresql://", "postgres://"):
        if url.startswith(scheme):
            return "postgresql+psycopg://" + url.removeprefix(scheme)
    return url


def _make_private(file: str | None) -> None:
    """Make a file that is not there yet for its owner alone; -wal and -shm take its rights."""
    if not file or file == ":memory:" or file.startswith("file:"):
        return
    with suppress(OSError):  # it exists or cannot be created: SQLite reports which
        os.close(os.open(file, os.O_RDWR | os.O_CREAT | os.O_EXCL, _OWN))


def _prepare_sqlite(connection: Any, _record: object) -> None:
    connection.isolation_level = None  # transactions are begun by _begin_sqlite
    connection.execute(f"PRAGMA busy_timeout = {BUSY_TIMEOUT_MS}")
    connection.execute("PRAGMA foreign_keys = ON")
    _write_ahead(connection)
    # In WAL mode a power cut can lose the last transactions but cannot damage the file.
    connection.execute("PRAGMA synchronous = NORMAL")


def _sync_each_commit(connection: Any, _record: object) -> None:
    connection.execute("PRAGMA synchronous = FULL")


def _write_ahead(connection: Any) -> None:
    """Switch to WAL mode, in which readers do not wait for the writer. The first switch needs
    exclusive access, for which SQLite does not wait by itself; hence the retries."""
    for attempt in range(50):
        if connection.execute("PRAGMA journal_mode").fetchone()[0] in ("wal", "memory"):
            return
        try:
            connection.execute("PRAGMA journal_mode = WAL")
        except connection.OperationalError:
            time.sleep(0.02 * (attempt + 1))
            continue
        return


def _begin_sqlite(connection: Connection) -> None:
    writes = connection.get_execution_options().get(_WRITES)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
