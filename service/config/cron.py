"""``CronTimes``: the instants of a cron expression in local time.

APScheduler evaluates the fields, always in UTC; its results are taken as local times and converted
here. Asked in a zone with daylight saving time, version 3.11 skips instants (1 April at midnight,
seen from March), and it counts weekdays from Monday.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

if TYPE_CHECKING:
    from apscheduler.triggers.cron import CronTrigger

_DAYS = ("sun", "mon", "tue", "wed", "thu", "fri", "sat")
_INSTANT = timedelta(microseconds=1)
_NEAR = timedelta(hours=4)  # no clock is changed by more at a time
_PART = re.compile(r"(?P<first>\*|[a-z0-9]+)(-(?P<last>[a-z0-9]+))?(/(?P<step>\d+))?")
_WORDS = {
    "@hourly": "0 * * * *",
    "@daily": "0 0 * * *",
    "@weekly": "0 0 * * 0",
    "@monthly": "0 0 1 * *",
}


class CronTimes:
    """The instants of five cron fields (minute, hour, day of month, month, day of week) in
    ``zone``.

    When clocks go forward, an instant in the skipped hour comes one hour later. When they go back,
    an instant in the repeated hour comes the first time only, unless the schedule is for every
    hour. Raises ``ValueError`` for an invalid expression.
    """

    def __init__(self, expression: str, zone: str) -> None:
        self._trigger = _wall_trigger(expression)
        self._zone = ZoneInfo(zone)
        self._each_hour = _fields(expression)[1].startswith("*")

    def after(self, instant: datetime) -> datetime | None:
        """The first instant later than ``instant``, in UTC; ``None`` where there is none."""
        if self._offset(instant - _NEAR) == self._offset(instant + _NEAR):
            wall = self._next(self._wall(instant))
            while wall is not None:
                first = self._instants(wall)[0]
                if first > instant:
                    return first
                wall = self._next(wall)
            return None
        return self._across_a_change(instant)

    def _across_a_change(self, instant: datetime) -> datetime | None:
        """``after`` near a change of clocks, where local times are not in the order of instants."""
        instants: list[datetime] = []
        wall = self._next(self._wall(instant - _NEAR))
        while wall is not None:
            instants += [candidate for candidate in self._instants(wall) if candidate > instant]
            if instants and wall > self._wall(instants[0] + _NEAR):
                break
            wall = self._next(wall)
        return min(instants, default=None)

    def _instants(self, wall: datetime) -> list[datetime]:
        """The instants with the local time ``wall``: one, or two in a repeated hour."""
        instants = [wall.replace(tzinfo=self._zone, fold=fold).astimezone(UTC) for fold in (0, 1)]
        is_repeated = instants[0] < instants[1]
        return instants if is_repeated and self._each_hour else instants[:1]

    def _offset(self, instant: datetime) -> timedelta | None:
        return instant.astimezone(self._zone).utcoffset()

    def _wall(self, instant: datetime) -> datetime:
        return instant.astimezone(self._zone).replace(tzinfo=None)

    def _next(self, wall: datetime) -> datetime | None:
        later = (wall + _INSTANT).replace(tzinfo=UTC)
        fires: datetime | None = self._trigger.get_next_fire_time(None, later)
        return None if fires is None else fires.replace(tzinfo=None)


def _wall_trigger(expression: str) -> CronTrigger:
    """APScheduler's trigger for the fields, in UTC.

    Weekdays count as in cron: 0 and 7 are Sunday. Where day of month and day of week are both
    restricted, both must match. Raises ``ValueError`` for an invalid expression.
    """
    from apscheduler.triggers.cron import CronTrigger

    fields = _fields(expression)
    if len(fields) != 5:
        raise ValueError(
            f"{len(fields)} fields; expected five: minute, hour, day of month, month, day of week, "
            'such as "30 5 * * 1" for Mondays at 5:30'
        )
    minute, hour, day, month, weekday = fields
    return CronTrigger(
        minute=minute,
        hour=hour,
        day=day,
        month=month.lower(),
        day_of_week=_days_of_week(weekday.lower()),
        timezone=UTC,
    )


def _fields(expression: str) -> list[str]:
    return _WORDS.get(expression.strip().lower(), expression).split()


def _days_of_week(field: str) -> str:
    """``1-5`` as ``mon,tue,wed,thu,fri``, since APScheduler numbers weekdays differently."""
    if field == "*":
        return field
    days: set[int] = set()
    for part in field.split(","):
        match = _PART.fullmatch(part)
        if match is None:
            raise ValueError(f"day of week {part!r}; expected such as 1, mon, 1-5 or mon-fri")
        first = 0 if match["first"] == "*" else _day(match["first"])
        last = _last(first, match)
        days.update(day % 7 for day in range(first, last + 1, int(match["step"] or 1) or 1))
    return ",".join(_DAYS[day] for day in sorted(days))


def _last(first: int, match: re.Match[str]) -> int:
    if match["first"] == "*":
        return 6
    if match["last"] is None:
        return 6 if match["step"] else first
    last = _day(match["last"])
    return last if last >= first else last + 7  # sat-mon goes over the week's end


def _day(text: str) -> int:
    if text in _DAYS:
        return _DAYS.index(text)
    if text.isascii() and text.isdigit() and int(text) <= 7:
        return int(text)
    raise ValueError(
        f"day of week {text!r}; expected 0 (Sunday) to 7, or one of {', '.join(_DAYS)}"
    )
