"""``Schedules``: the schedules of the plant file, and up to which instant each was run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import delete, select, update

from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.runs.schedule import ScreeningSchedule
from stemwatch.service.store.runs.tables import ScheduleRow

FROM_FILE = "plant.toml"  # the only origin of schedules


@dataclass(frozen=True, kw_only=True)
class StoredSchedule:
    """A schedule; ``last_due`` is the last instant that was queued or noted as missed."""

    schedule: ScreeningSchedule
    created: datetime
    last_due: datetime | None
    next_due: datetime | None


class Schedules:
    """The schedules in the store. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def take_from_file(self, schedules: Sequence[ScreeningSchedule]) -> None:
        """Replace the stored schedules by those of the plant file. One whose timing is unchanged
        keeps its ``last_due``."""
        with self._transactions.writing("taking over the plant file's schedules") as session:
            names = [schedule.name for schedule in schedules]
            session.execute(
                delete(ScheduleRow).where(
                    ScheduleRow.origin == FROM_FILE, ScheduleRow.name.not_in(names)
                )
            )
            now = datetime.now(UTC)
            for schedule in schedules:
                kept = session.get(ScheduleRow, schedule.name)
                if kept is None or _timing(kept) != (schedule.cron, schedule.every_s):
                    # A changed timing starts now: instants missed by the old one are not made up.
                    values = _columns(schedule) | {
                        "created": now,
                        "last_due": None,
                        "next_due": None,
                    }
                else:
                    values = _columns(schedule) | {"created": kept.created}
                session.execute(upsert(session, ScheduleRow, [values], ("name",)))

    def all(self) -> list[StoredSchedule]:
        """Every schedule, by name."""
        with self._transactions.reading() as session:
            rows = session.scalars(select(ScheduleRow).order_by(ScheduleRow.name))
            return [_stored(row) for row in rows]

    def note(self, name: str, last_due: datetime | None, next_due: datetime | None) -> None:
        """Set when a schedule was last due (``None``: unchanged) and when it is due next."""
        values: dict[str, datetime | None] = {"next_due": next_due}
        if last_due is not None:
            values["last_due"] = last_due
        with self._transactions.writing(f"noting the schedule {name}") as session:
            session.execute(update(ScheduleRow).where(ScheduleRow.name == name).values(**values))


def _timing(row: ScheduleRow) -> tuple[str | None, float | None]:
    return row.cron, row.every_s


def _columns(schedule: ScreeningSchedule) -> dict[str, object]:
    return {
        "name": schedule.name,
        "origin": FROM_FILE,
        "cron": schedule.cron,
        "every_s": schedule.every_s,
        "jitter_s": schedule.jitter_s,
        "window_s": schedule.window_s,
        "areas": list(schedule.areas),
        "valves": list(schedule.valves),
        "enabled": schedule.enabled,
    }


def _stored(row: ScheduleRow) -> StoredSchedule:
    schedule = ScreeningSchedule(
        name=row.name,
        cron=row.cron,
        every_s=row.every_s,
        jitter_s=row.jitter_s,
        window_s=row.window_s,
        areas=tuple(row.areas),
        valves=tuple(row.valves),
        enabled=row.enabled,
    )
    return StoredSchedule(
        schedule=schedule, created=row.created, last_due=row.last_due, next_due=row.next_due
    )
