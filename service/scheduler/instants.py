"""The due instants of a schedule; they do not depend on when the process was started."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

from stemwatch.service.config.cron import CronTimes
from stemwatch.service.store.runs.schedule import ScreeningSchedule

# Intervals are counted from a fixed midnight, so that a restart does not shift them.
_ANCHOR = datetime(2000, 1, 3)
# Counting the instants of a schedule that is due every minute further back than this takes too
# long.
_LOOK_BACK = timedelta(days=32)
_MOST = 100_000


@dataclass(frozen=True, kw_only=True)
class Missed:
    """The instants of a schedule in an interval: the last one and their number.

    With ``at_least`` the interval was too long to count them all.
    """

    last: datetime
    count: int
    at_least: bool = False


def next_due(schedule: ScreeningSchedule, after: datetime, zone: str) -> datetime | None:
    """The first instant later than ``after``, in UTC; ``None`` where there is none."""
    if schedule.every_s is not None:
        number = _number(schedule, after, zone)
        return _instant(schedule, number + 1, zone)
    return _cron(schedule, zone).after(after)


def due_between(
    schedule: ScreeningSchedule, after: datetime, until: datetime, zone: str
) -> Missed | None:
    """The instants in (``after``, ``until``], or ``None`` where there are none."""
    if schedule.every_s is not None:
        first, last = (_number(schedule, instant, zone) for instant in (after, until))
        if last <= first:
            return None
        return Missed(last=_instant(schedule, last, zone), count=last - first)
    begin = max(after, until - _LOOK_BACK)
    missed = _count(schedule, begin, until, zone)
    if begin > after:
        if missed is not None:
            return Missed(last=missed.last, count=missed.count, at_least=True)
        return _count(schedule, after, until, zone)  # rare enough to be counted in full
    return missed


def jitter(schedule: ScreeningSchedule, due: datetime) -> timedelta:
    """How long after ``due`` the run starts: 0 to ``jitter_s``, uniformly distributed over names
    and instants, and the same in every process."""
    digest = hashlib.sha256(f"{schedule.name}|{due.timestamp():.6f}".encode()).digest()
    fraction = int.from_bytes(digest[:8], "big") / 2**64
    return timedelta(seconds=fraction * schedule.jitter_s)


def _count(
    schedule: ScreeningSchedule, after: datetime, until: datetime, zone: str
) -> Missed | None:
    times = _cron(schedule, zone)
    last, count = None, 0
    while count < _MOST:
        instant = times.after(after if last is None else last)
        if instant is None or instant > until:
            break
        last, count = instant, count + 1
    if last is None:
        return None
    return Missed(last=last, count=count, at_least=count == _MOST)


def _cron(schedule: ScreeningSchedule, zone: str) -> CronTimes:
    if schedule.cron is None:
        raise ValueError(f"schedule {schedule.name}: neither cron nor every_s is given")
    return CronTimes(schedule.cron, zone)


def _anchor(zone: str) -> datetime:
    return _ANCHOR.replace(tzinfo=ZoneInfo(zone)).astimezone(UTC)


def _number(schedule: ScreeningSchedule, instant: datetime, zone: str) -> int:
    """How many whole intervals lie between the anchor and ``instant``."""
    interval = timedelta(seconds=schedule.every_s or 1.0)
    return (instant - _anchor(zone)) // interval


def _instant(schedule: ScreeningSchedule, number: int, zone: str) -> datetime:
    return _anchor(zone) + number * timedelta(seconds=schedule.every_s or 1.0)
