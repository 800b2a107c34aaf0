"""``Leases`` and ``ServiceSettings``: who has a duty now, and what the service remembers."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import delete, select

from stemwatch.service.process_lifecycle import has_ended
from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions, database_now
from stemwatch.service.store.runs.tables import LeaseRow, SettingRow


class Leases:
    """Duties that one process at a time has. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def hold(self, name: str, owner: str, for_: timedelta) -> bool:
        """Take or renew the duty for so long; whether ``owner`` has it now. The duty of a process
        that is known to have ended is free."""
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
        """Who has the duty now."""
        with self._transactions.reading() as session:
            row = session.get(LeaseRow, name)
            if row is None or row.until < database_now(session) or has_ended(row.owner):
                return None
            return row.owner

    def let_go(self, name: str, owner: str) -> None:
        """Give the duty back, so that nobody has to wait for its end."""
        with self._transactions.writing(f"giving back {name}") as session:
            session.execute(delete(LeaseRow).where(LeaseRow.name == name, LeaseRow.owner == owner))


class ServiceSettings:
    """Values that the service keeps across restarts. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def get(self, name: str) -> dict[str, Any] | None:
        """What was kept under ``name``."""
        with self._transactions.reading() as session:
            row = session.get(SettingRow, name)
            return None if row is None else dict(row.value)

    def put(self, name: str, value: Mapping[str, Any], who: str = "") -> None:
        """Keep ``value`` under ``name``, in place of what was there."""
        with self._transactions.writing(f"keeping the setting {name}") as session:
            values = {
                "name": name,
                "value": dict(value),
                "changed": datetime.now(UTC),
                "who": who,
            }
            session.execute(upsert(session, SettingRow, [values], ("name",)))
