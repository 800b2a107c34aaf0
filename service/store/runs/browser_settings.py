"""``BrowserSettings``: settings that people made on the pages, each with who and when.

The plant file takes precedence for every setting that it names. Settings from the pages apply only
to others, and are shown and exported as such.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import delete, select

from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.runs.tables import SettingRow

_LIMIT, _SCHEDULE = "limit ", "schedule "
_VALUE = "value"


@dataclass(frozen=True, kw_only=True)
class SetLimit:
    """A limit of the verdict that somebody has set."""

    value: float
    who: str
    changed: datetime


@dataclass(frozen=True, kw_only=True)
class SetBy:
    """Who made or changed something last, and when."""

    who: str
    changed: datetime


class BrowserSettings:
    """Limits and the authors of schedules. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def limits(self) -> dict[str, SetLimit]:
        """Every limit that was set, by its name."""
        return {
            row.name.removeprefix(_LIMIT): SetLimit(
                value=float(row.value[_VALUE]), who=row.who, changed=row.changed
            )
            for row in self._rows(_LIMIT)
        }

    def set_limits(self, values: Mapping[str, float | None], who: str, now: datetime) -> None:
        """Set limits; ``None`` takes one back, so that the plant file's or the default holds."""
        removed = [_LIMIT + name for name, value in values.items() if value is None]
        remaining = [
            {"name": _LIMIT + name, "value": {_VALUE: value}, "changed": now, "who": who}
            for name, value in values.items()
            if value is not None
        ]
        with self._transactions.writing("setting limits") as session:
            if removed:
                session.execute(delete(SettingRow).where(SettingRow.name.in_(removed)))
            if remaining:
                session.execute(upsert(session, SettingRow, remaining, ("name",)))

    def schedules(self) -> dict[str, SetBy]:
        """Who set each schedule that was made on the pages."""
        return {
            row.name.removeprefix(_SCHEDULE): SetBy(who=row.who, changed=row.changed)
            for row in self._rows(_SCHEDULE)
        }

    def note_schedule(self, name: str, who: str, now: datetime) -> None:
        """Keep who made or changed a schedule."""
        row = {"name": _SCHEDULE + name, "value": {}, "changed": now, "who": who}
        with self._transactions.writing(f"noting who set the schedule {name}") as session:
            session.execute(upsert(session, SettingRow, [row], ("name",)))

    def forget_schedule(self, name: str) -> None:
        """Forget who made a schedule that is gone."""
        with self._transactions.writing(f"forgetting the schedule {name}") as session:
            session.execute(delete(SettingRow).where(SettingRow.name == _SCHEDULE + name))

    def _rows(self, prefix: str) -> list[SettingRow]:
        with self._transactions.reading() as session:
            named = SettingRow.name.startswith(prefix, autoescape=True)
            return list(session.scalars(select(SettingRow).where(named).order_by(SettingRow.name)))
