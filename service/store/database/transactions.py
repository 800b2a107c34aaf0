"""``Transactions``: database sessions for reading and for writing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime

from sqlalchemy import Engine, text
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from stemwatch.service.interruption import interrupts_held
from stemwatch.service.store.database.engine import error_text, for_writing, store_errors
from stemwatch.service.store.database_url import DatabaseUrl

# The reads here look up pages of valves and their latest rows by index. PostgreSQL's planner
# prefers to scan the whole table for such joins: measured 220 ms against 50 ms for a ranking of
# 5,000 valves after 30 days, and growing with the table.
_SEEK = text("SET LOCAL enable_hashjoin = off; SET LOCAL enable_mergejoin = off")


class Transactions:
    """Sessions of one database; each ``with`` block is one transaction, which Ctrl-C and SIGTERM
    do not cut in two. Database errors are raised as ``StoreError``."""

    def __init__(self, engine: Engine, address: DatabaseUrl) -> None:
        self.readers = engine
        self.writers = for_writing(engine)
        self.address = address
        self._fault = ""

    @property
    def is_sqlite(self) -> bool:
        """Whether the database is SQLite rather than PostgreSQL."""
        return self.readers.dialect.name == "sqlite"

    @property
    def write_fault(self) -> str:
        """Why the last write transaction failed: the disk is full, the file is read-only, the
        server is not available. Empty where it succeeded, or was refused because of its data."""
        return self._fault

    @contextmanager
    def reading(self, doing: str = "reading") -> Iterator[Session]:
        """A session for reading; ``doing`` is the activity that an error names."""
        with (
            interrupts_held(),
            store_errors(self.address, doing),
            Session(self.readers) as session,
        ):
            if not self.is_sqlite:
                session.execute(_SEEK)
            yield session

    @contextmanager
    def writing(self, doing: str) -> Iterator[Session]:
        """A session that is committed at the end of the block, or rolled back after an error."""
        with (
            interrupts_held(),
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
            self._fault = error_text(error, self.address)
            raise
        self._fault = ""


def database_now(session: Session) -> datetime:
    """The time in UTC on a clock that all processes of one database share.

    PostgreSQL's own clock, since its clients may run on machines whose clocks differ; SQLite is
    used from one machine only.
    """
    if session.get_bind().dialect.name == "sqlite":
        return datetime.now(UTC)
    now: datetime = session.execute(text("SELECT clock_timestamp()")).scalar_one()
    return now.astimezone(UTC)
