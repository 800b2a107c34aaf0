"""``AuditLog``: who did or tried what, and the outcome. Entries are never changed or removed."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import select

from stemwatch.service.store.accounts.records import AuditEntry, AuditOutcome, StoredAuditEntry
from stemwatch.service.store.accounts.tables import AuditRow
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.storable import from_row

LONGEST = 500  # characters of a field: texts from outside must not fill the database
LONGEST_SIGNED_IN = 10_000  # of what a known user did, which may name every alert of a plant
CUT = " … (cut)"


@dataclass(frozen=True, kw_only=True)
class AuditFilter:
    """Which entries to read; empty fields do not filter. ``before`` is an entry's number: only
    older entries are read."""

    who: str = ""
    action: str = ""
    outcome: AuditOutcome | None = None
    start: datetime | None = None
    stop: datetime | None = None
    before: int | None = None
    limit: int = 100


class AuditLog:
    """The stored entries. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def add(self, entry: AuditEntry) -> None:
        """Add an entry."""
        longest = LONGEST_SIGNED_IN if entry.how else LONGEST
        with self._transactions.writing("writing the audit log") as session:
            session.add(
                AuditRow(
                    at=entry.at,
                    who=_shortened(entry.who),
                    how=_shortened(entry.how),
                    address=_shortened(entry.address),
                    action=_shortened(entry.action),
                    about=_shortened(entry.about, longest),
                    outcome=entry.outcome.value,
                    detail=_shortened(entry.detail, longest),
                )
            )

    def read(self, audit_filter: AuditFilter) -> list[StoredAuditEntry]:
        """Entries, the newest first."""
        statement = select(AuditRow).order_by(AuditRow.id.desc()).limit(audit_filter.limit)
        if audit_filter.who:
            statement = statement.where(AuditRow.who == audit_filter.who)
        if audit_filter.action:
            statement = statement.where(AuditRow.action == audit_filter.action)
        if audit_filter.outcome is not None:
            statement = statement.where(AuditRow.outcome == audit_filter.outcome.value)
        if audit_filter.start is not None:
            statement = statement.where(AuditRow.at >= audit_filter.start)
        if audit_filter.stop is not None:
            statement = statement.where(AuditRow.at < audit_filter.stop)
        if audit_filter.before is not None:
            statement = statement.where(AuditRow.id < audit_filter.before)
        with self._transactions.reading() as session:
            return [_entry_of(row) for row in session.scalars(statement)]

    def actions(self) -> list[str]:
        """The actions that occur in the log, sorted."""
        with self._transactions.reading() as session:
            return list(session.scalars(select(AuditRow.action).distinct().order_by("action")))


def _shortened(text: str, longest: int = LONGEST) -> str:
    """``text``, which says so where its end was left out."""
    return text if len(text) <= longest else text[: longest - len(CUT)] + CUT


def _entry_of(row: AuditRow) -> StoredAuditEntry:
    return from_row(StoredAuditEntry, row, outcome=AuditOutcome(row.outcome))
