"""``Sources``: the state of each source, and the files that were read from watched folders."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime

from sqlalchemy import select

from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.samples.tables import SourceStateRow, TakenFileRow
from stemwatch.service.store.storable import columns_of, from_row


@dataclass(frozen=True, kw_only=True)
class SourceState:
    """The state of a source. ``figures`` are counts, and lateness in seconds (``..._s``)."""

    source: str
    kind: str  # "modbus" or "folder"
    address: str = ""  # without secrets
    updated: datetime = field(default_factory=lambda: datetime.now(UTC))
    last_good: datetime | None = None
    connected: bool = True
    fault: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class TakenFile:
    """A file of a watched folder. ``note`` says what was read, or why it was rejected; ``too_old``
    of its samples are removed within the hour, since they are older than those that are kept."""

    digest: str  # sha256 of its bytes, hexadecimal
    name: str
    source: str
    accepted: bool
    samples: int = 0
    note: str = ""
    too_old: int = 0
    taken: datetime = field(default_factory=lambda: datetime.now(UTC))


class Sources:
    """States of sources, and files of watched folders. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def note(self, state: SourceState) -> None:
        """Store the present state of a source."""
        values = columns_of(state, figures=dict(state.figures))
        with self._transactions.writing(f"noting the state of {state.source}") as session:
            session.execute(upsert(session, SourceStateRow, [values], ("source",)))

    def states(self) -> list[SourceState]:
        """The state of every source, by name."""
        with self._transactions.reading() as session:
            rows = session.scalars(select(SourceStateRow).order_by(SourceStateRow.source))
            return [from_row(SourceState, row) for row in rows]

    def taken(self, digest: str) -> TakenFile | None:
        """The file with this digest, if one was read or rejected before."""
        with self._transactions.reading() as session:
            row = session.get(TakenFileRow, digest)
            return None if row is None else _file(row)

    def note_taken(self, file: TakenFile) -> None:
        """Record that a file was read or rejected; replaces an earlier entry for the same bytes."""
        with self._transactions.writing(f"noting the file {file.name}") as session:
            session.execute(upsert(session, TakenFileRow, [columns_of(file)], ("digest",)))

    def files(self, source: str | None = None, limit: int = 100) -> list[TakenFile]:
        """The last files, newest first."""
        statement = select(TakenFileRow).order_by(TakenFileRow.taken.desc()).limit(limit)
        if source is not None:
            statement = statement.where(TakenFileRow.source == source)
        with self._transactions.reading() as session:
            return [_file(row) for row in session.scalars(statement)]


def _file(row: TakenFileRow) -> TakenFile:
    return from_row(TakenFile, row)
