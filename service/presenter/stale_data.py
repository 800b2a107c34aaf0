"""Why the results on a page are out of date: silent sources, runs that did not begin or failed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

# A run that has not begun so long after its instant, the schedule's spread included, is overdue.
OVERDUE = timedelta(minutes=15)
OLD_WITH_SCHEDULE = timedelta(days=2)
OLD_WITHOUT = timedelta(days=31)


@dataclass(frozen=True, kw_only=True)
class DueSchedule:
    """A schedule that is switched on: when it is due next, and over how long its runs are
    spread."""

    name: str
    next_due: datetime | None
    spread: timedelta


@dataclass(frozen=True, kw_only=True)
class SilentSource:
    """A source that does not deliver; ``fault`` says why, where it is known."""

    name: str
    last_good: datetime | None
    fault: str = ""


def stale_data(
    now: datetime,
    *,
    newest: datetime | None,
    schedules: Sequence[DueSchedule],
    silent: Iterable[SilentSource],
    failed: str = "",
) -> list[str]:
    """A sentence for each reason why what is shown may be older than it looks; none where all is as
    it should be.

    ``newest`` is the end of the newest window that was screened, ``failed`` what the last run that
    is over says of its failure, empty where it did not fail.
    """
    sentences = [_silent(source, now) for source in silent]
    sentences += [
        f"The schedule {schedule.name} was due {_ago(now - schedule.next_due)} ago and has not "
        "begun: check whether stemwatch serve is running."
        for schedule in schedules
        if schedule.next_due is not None and now - schedule.next_due > OVERDUE + schedule.spread
    ]
    if failed:
        sentences.append(f"The last run failed: {failed.rstrip('.')}.")
    limit = OLD_WITH_SCHEDULE if schedules else OLD_WITHOUT
    if newest is not None and now - newest > limit:
        sentences.append(
            f"The newest recording that was screened ended {_ago(now - newest)} ago: what is shown "
            "here is as old."
        )
    return sentences


def _silent(source: SilentSource, now: datetime) -> str:
    since = (
        "has not delivered a good sample yet"
        if source.last_good is None
        else f"has delivered no good sample for {_ago(now - source.last_good)}"
    )
    fault = f" ({source.fault.rstrip('.')})" if source.fault else ""
    return f"The source {source.name} {since}{fault}: its valves are not watched."


def _ago(age: timedelta) -> str:
    """How long, in whole minutes, hours or days."""
    minutes = max(round(age.total_seconds() / 60.0), 0)
    for size, unit in ((1440, "day"), (60, "hour"), (1, "minute")):
        if minutes >= 2 * size or size == 1:
            count = minutes // size
            return f"{count} {unit}{'' if count == 1 else 's'}"
    return ""
