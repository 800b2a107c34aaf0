"""The only place that talks to the database: it connects, queries, and never commits."""

from __future__ import annotations

import math
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stemwatch.connectors.connection_deadline import close_after
from stemwatch.connectors.connector import ConnectorError, UnreadableSource
from stemwatch.connectors.secret import Secret, masked

if TYPE_CHECKING:
    from sqlalchemy import Connection, Engine

# What makes a session read only, for engines where SQLAlchemy has no option of its own.
_READ_ONLY = {
    "sqlite": "PRAGMA query_only = ON",
    "mysql": "SET SESSION TRANSACTION READ ONLY",
    "mariadb": "SET SESSION TRANSACTION READ ONLY",
    "oracle": "SET TRANSACTION READ ONLY",
}
_IN_ZONE = "SELECT set_config('TimeZone', :zone, true)"  # until the end of the transaction
_TIMEOUT_S = "stemwatch_timeout_s"


class Database:
    """A database that is only read.

    Each reading has a connection and a transaction of its own, read only where the engine can,
    which ends in a rollback. A query to PostgreSQL without an answer for ``timeout_s`` is given up;
    other engines have the time-outs that their drivers take from the URL. Columns of PostgreSQL
    without a zone are compared as local times of ``zone``, where one is given.
    """

    def __init__(self, url: Secret, name: str, timeout_s: float, zone: str | None = None) -> None:
        self._url = url
        self._timeout_s = timeout_s
        self._zone = zone
        self.name = name

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """A connection. Raises ``ConnectorError`` where it cannot be made or a query fails."""
        from sqlalchemy import text
        from sqlalchemy.exc import SQLAlchemyError

        engine = self._engine()
        try:
            with engine.connect() as connection:
                if engine.dialect.name == "postgresql":
                    connection = connection.execution_options(postgresql_readonly=True)
                connection.info[_TIMEOUT_S] = self._timeout_s
                if engine.dialect.name == "postgresql" and self._zone is not None:
                    connection.execute(text(_IN_ZONE), {"zone": self._zone})
                yield connection
                connection.rollback()
        except TimeoutError as error:
            raise ConnectorError(f"{self.name}: {error}") from None
        except SQLAlchemyError as error:
            raise self._explained(error) from None
        finally:
            engine.dispose()

    @property
    def dialect(self) -> str:
        """The engine's name in SQLAlchemy, such as ``postgresql``."""
        return self._engine().dialect.name

    @property
    def only_reads(self) -> bool:
        """Whether the engine itself refuses to write in our transactions."""
        return self.dialect == "postgresql" or self.dialect in _READ_ONLY

    def _engine(self) -> Engine:
        from sqlalchemy import create_engine, event, make_url
        from sqlalchemy.exc import SQLAlchemyError
        from sqlalchemy.pool import NullPool

        try:
            url = make_url(self._url.reveal())
            if url.drivername == "postgresql":
                url = url.set(drivername="postgresql+psycopg")
            _check_file(url.get_backend_name(), url.database, self.name)
            timeout = {"connect_timeout": max(2, math.ceil(self._timeout_s))}
            is_postgres = url.drivername == "postgresql+psycopg"
            engine = create_engine(
                url,
                poolclass=NullPool,
                hide_parameters=True,
                connect_args=timeout if is_postgres else {},
            )
        except (SQLAlchemyError, ImportError) as error:
            raise UnreadableSource(
                f"{self.name}: the database URL cannot be used "
                f"({masked(str(error)).splitlines()[0]}); expected a URL such as "
                "postgresql://user@host/database, and the driver that it names installed"
            ) from None
        if statement := _READ_ONLY.get(engine.dialect.name):
            event.listen(engine, "connect", lambda raw, _: _execute(raw, statement))
        return engine

    def _explained(self, error: Exception) -> ConnectorError:
        message = masked(str(getattr(error, "orig", None) or error)).strip()
        first_line = message.splitlines()[0] if message else type(error).__name__
        return ConnectorError(
            f"{self.name}: the database did not answer the query ({first_line}); check that it is "
            "reached and that the query runs there as it stands, with this account"
        )


def run_query(
    connection: Connection, query: str, parameters: Mapping[str, Any], chunk: int
) -> tuple[Sequence[str], Iterator[Sequence[Sequence[Any]]]]:
    """Names of the columns, and the rows in parts of at most ``chunk``, as they come in. Raises
    ``TimeoutError`` where the database falls silent."""
    from sqlalchemy import text

    streamed = connection.execution_options(stream_results=True, yield_per=chunk)
    with _not_silent(connection):
        result = streamed.execute(text(query), dict(parameters))
    return list(result.keys()), _parts(connection, result.partitions())


def _parts(
    connection: Connection, parts: Iterator[Sequence[Sequence[Any]]]
) -> Iterator[Sequence[Sequence[Any]]]:
    while True:
        with _not_silent(connection):
            part = next(parts, None)
        if part is None:
            return
        yield part


@contextmanager
def _not_silent(connection: Connection) -> Iterator[None]:
    """Close the connection where the block takes longer than the time-out."""
    from sqlalchemy.exc import SQLAlchemyError

    timeout_s = connection.info[_TIMEOUT_S]
    if connection.dialect.driver != "psycopg":
        yield
        return
    handle: Any = connection.connection.driver_connection
    with (
        socket.socket(fileno=os.dup(handle.fileno())) as link,
        close_after(timeout_s, lambda: link) as was_cut,
    ):
        try:
            yield
        except SQLAlchemyError:
            if not was_cut.is_set():
                raise
            raise TimeoutError(
                f"the database has said nothing for {timeout_s:g} s; check that it and the network "
                "to it work, and whether the query needs an index; timeout_s may be longer"
            ) from None


def _execute(raw: Any, statement: str) -> None:
    cursor = raw.cursor()
    cursor.execute(statement)
    cursor.close()


def _check_file(backend: str, database: str | None, name: str) -> None:
    """Raise ``UnreadableSource`` for a missing SQLite file, which SQLite would create."""
    if backend != "sqlite" or not database or database == ":memory:":
        return
    if not database.startswith("file:") and not Path(database).is_file():
        raise UnreadableSource(f"{name}: there is no file {database}; expected a SQLite database")
