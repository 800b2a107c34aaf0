"""``Leases``: tasks that only one process may do at a time, such as serving a store."""

from __future__ import annotations

from datetime import timedelta

from sqlalchemy import delete, select

from stemwatch.service.process_lifecycle import has_ended
from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions, database_now
from stemwatch.service.store.runs.tables import LeaseRow


class Leases:
    """Leases by name. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def hold(self, name: str, owner: str, for_: timedelta) -> bool:
        """Take or renew the lease for this long; whether ``owner`` has it now. The lease of a
        process that is known to have ended is free."""
        with self._transactions.writing(f"taking over {name}") as session:
            now = database_now(session)
            values = {"name": name, "owner": owner, "until": now + for_}
            session.execute(upsert(session, LeaseRow, [values], ("name",), update=False))
            row = session.scalar(select(LeaseRow).where(LeaseRow.name == name).with_for_update())
            if row is None or not (row.owner == owner or row.until < now or has_ended(row.owner)):
                return False
            row.owner, row.until = owner, now + for_
            return True

    def holder(self, name: str) -> str | None:
        """The owner of the lease, ``None`` where it has run out."""
        with self._transactions.reading() as session:
            row = session.get(LeaseRow, name)
            if row is None or row.until < database_now(session) or has_ended(row.owner):
                return None
            return row.owner

    def release(self, name: str, owner: str) -> None:
        """Return the lease, so that the next owner need not wait for its end."""
        with self._transactions.writing(f"giving back {name}") as session:
            session.execute(delete(LeaseRow).where(LeaseRow.name == name, LeaseRow.owner == owner))
