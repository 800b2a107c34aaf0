"""``Transactions``: sessions for reading and for writing, with errors that name the store."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime

from sqlalchemy import Engine, text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from stemwatch.service.store.database.engine import for_writing, plainly, store_errors
from stemwatch.service.store.database_url import DatabaseUrl

# What is read here are pages of valves and their latest rows, found by index. PostgreSQL would
# rather read all the years of a table to join a few thousand rows of it: measured 220 ms against
# 50 ms for a ranking of 5,000 valves after 30 days, and growing.
_SEEK = text("SET LOCAL enable_hashjoin = off; SET LOCAL enable_mergejoin = off")


class Transactions:
    """What every part of the store works through. Each block is one transaction.

    Raises ``StoreError`` for whatever the database says.
    """

    def __init__(self, engine: Engine, address: DatabaseUrl) -> None:
        self.readers = engine
        self.writers = for_writing(engine)
        self.address = address
        self._fault = ""

    @property
    def is_sqlite(self) -> bool:
        """Whether the database is a file of SQLite rather than PostgreSQL."""
        return self.readers.dialect.name == "sqlite"

    @property
    def write_fault(self) -> str:
        """Why the last transaction that was to write could not: the disk is full, the file may not
        be written, the server is away. Empty where it could, or was refused for what it held."""
        return self._fault

    @contextmanager
    def reading(self, doing: str = "reading") -> Iterator[Session]:
        """A session that only reads; ``doing`` is for the error's sentence."""
        with store_errors(self.address, doing), Session(self.readers) as session:
            if not self.is_sqlite:
                session.execute(_SEEK)
            yield session

    @contextmanager
    def writing(self, doing: str) -> Iterator[Session]:
        """A session that is committed at the block's end, or rolled back by an error."""
        with (
            store_errors(self.address, doing),
            self._noting_faults(),
            Session(self.writers, expire_on_commit=False) as session,
            session.begin(),
        ):
            yield session

    @contextmanager
    def _noting_faults(self) -> Iterator[None]:
        try:
            yield
        except OperationalError as error:
            self._fault = plainly(error, self.address)
            raise
        self._fault = ""


def database_now(session: Session) -> datetime:
    """The instant on the clock that all processes of one database share, in UTC.

    PostgreSQL's own, since its clients may be several machines whose clocks differ; with SQLite
    there is one machine.
    """
    if session.get_bind().dialect.name == "sqlite":
        return datetime.now(UTC)
    now: datetime = session.execute(text("SELECT clock_timestamp()")).scalar_one()
    return now.astimezone(UTC)
