"""``Schedules``: those of the plant file and of the pages, and up to which instant each was run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session

from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.runs.schedule import ScreeningSchedule
from stemwatch.service.store.runs.tables import ScheduleRow
from stemwatch.service.store.storable import from_row

FROM_FILE, FROM_BROWSER = "plant.toml", "browser"  # where a schedule comes from


@dataclass(frozen=True, kw_only=True)
class StoredSchedule:
    """A schedule; ``last_due`` is the last instant that was queued or noted as missed, ``origin``
    where it comes from."""

    schedule: ScreeningSchedule
    origin: str
    created: datetime
    last_due: datetime | None
    next_due: datetime | None


class Schedules:
    """The schedules in the store. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def take_from_file(self, schedules: Sequence[ScreeningSchedule]) -> None:
        """Replace the schedules of the plant file by those that it has now; one of its names that
        was made on the pages becomes the file's. One whose timing is unchanged keeps its
        ``last_due``."""
        with self._transactions.writing("taking over the plant file's schedules") as session:
            names = [schedule.name for schedule in schedules]
            session.execute(
                delete(ScheduleRow).where(
                    ScheduleRow.origin == FROM_FILE, ScheduleRow.name.not_in(names)
                )
            )
            for schedule in schedules:
                _keep(session, schedule, FROM_FILE)

    def set(self, schedule: ScreeningSchedule) -> bool:
        """Make or change a schedule of the pages; false where the plant file has one of its
        name."""
        with self._transactions.writing(f"setting the schedule {schedule.name}") as session:
            row = session.get(ScheduleRow, schedule.name)
            if row is not None and row.origin == FROM_FILE:
                return False
            _keep(session, schedule, FROM_BROWSER)
            return True

    def remove(self, name: str) -> bool:
        """Remove a schedule of the pages; false where there is none of this name."""
        with self._transactions.writing(f"removing the schedule {name}") as session:
            conditions = (ScheduleRow.name == name, ScheduleRow.origin == FROM_BROWSER)
            exists = session.scalar(select(ScheduleRow.name).where(*conditions)) is not None
            session.execute(delete(ScheduleRow).where(*conditions))
            return exists

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


def _keep(session: Session, schedule: ScreeningSchedule, origin: str) -> None:
    """Insert or change one schedule."""
    row = session.get(ScheduleRow, schedule.name)
    if row is None or _timing(row) != (schedule.cron, schedule.every_s):
        # A changed timing starts now: instants missed by the old one are not made up.
        since: dict[str, object] = {"created": datetime.now(UTC), "last_due": None}
        values = _columns(schedule, origin) | since | {"next_due": None}
    else:
        values = _columns(schedule, origin) | {"created": row.created}
    session.execute(upsert(session, ScheduleRow, [values], ("name",)))


def _columns(schedule: ScreeningSchedule, origin: str) -> dict[str, object]:
    return {
        "name": schedule.name,
        "origin": origin,
        "cron": schedule.cron,
        "every_s": schedule.every_s,
        "jitter_s": schedule.jitter_s,
        "window_s": schedule.window_s,
        "areas": list(schedule.areas),
        "units": list(schedule.units),
        "valves": list(schedule.valves),
        "enabled": schedule.enabled,
    }


def _stored(row: ScheduleRow) -> StoredSchedule:
    lists = {name: tuple(getattr(row, name)) for name in ("areas", "units", "valves")}
    schedule = from_row(ScreeningSchedule, row, **lists)
    return StoredSchedule(
        schedule=schedule,
        origin=row.origin,
        created=row.created,
        last_due=row.last_due,
        next_due=row.next_due,
    )
