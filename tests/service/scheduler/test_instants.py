"""Instants of schedules: as cron means them, in the plant's zone, the same for every process."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.service.config.cron import CronTimes
from stemwatch.service.scheduler.instants import due_between, jitter, next_due
from stemwatch.service.store.runs.schedule import ScreeningSchedule

BERLIN = "Europe/Berlin"
NOON = datetime(2026, 3, 2, 12, 0, tzinfo=UTC)  # a Monday
DAY = timedelta(days=1)


def local(instant: datetime | None) -> str:
    return instant.astimezone(ZoneInfo(BERLIN)).strftime("%a %d.%m. %H:%M")


@pytest.mark.parametrize(
    ("cron", "expected"),
    [
        ("30 5 * * *", "Tue 03.03. 05:30"),
        ("0 6 * * 0", "Sun 08.03. 06:00"),
        ("0 6 * * 7", "Sun 08.03. 06:00"),
        ("0 6 * * 1", "Mon 09.03. 06:00"),
        ("0 6 * * sat-sun", "Sat 07.03. 06:00"),
        ("0 6 * * 5-1", "Fri 06.03. 06:00"),
        ("0 6 * * */3", "Wed 04.03. 06:00"),
        ("*/20 * * * *", "Mon 02.03. 13:20"),
        ("0 0 1 * *", "Wed 01.04. 00:00"),
        ("@daily", "Tue 03.03. 00:00"),
    ],
)
def test_cron_as_cron_means_it(cron: str, expected: str) -> None:
    """Five fields in the plant's zone; 0 and 7 are Sunday, as everywhere but in the library."""
    assert local(next_due(ScreeningSchedule(name="s", cron=cron), NOON, BERLIN)) == expected


@pytest.mark.parametrize("cron", ["* * * *", "61 * * * *", "0 6 * * 8", "0 6 * * fr", "x * * * *"])
def test_a_cron_that_is_none_is_refused(cron: str) -> None:
    """A wrong expression is refused when it is read, not when it would be due."""
    with pytest.raises(ValueError, match=r"."):
        CronTimes(cron, BERLIN)


def test_a_day_keeps_its_hour_when_clocks_change() -> None:
    """At 5:30 means at 5:30 on the wall, in summer as in winter."""
    schedule = ScreeningSchedule(name="s", cron="30 5 * * *")
    before = datetime(2026, 3, 28, 12, 0, tzinfo=UTC)  # clocks go forward in the night
    first = next_due(schedule, before, BERLIN)
    assert first - next_due(schedule, before - DAY, BERLIN) == timedelta(hours=23)
    assert local(first) == "Sun 29.03. 05:30"


def test_the_hours_that_clocks_leave_out_and_repeat() -> None:
    """Nothing is lost in spring, nothing comes twice in autumn, and each hour has its run."""
    nightly = ScreeningSchedule(name="s", cron="30 2 * * *")
    spring = datetime(2026, 3, 28, 22, 0, tzinfo=UTC)
    assert local(next_due(nightly, spring, BERLIN)) == "Sun 29.03. 03:30"
    autumn = datetime(2026, 10, 24, 22, 0, tzinfo=UTC)
    first = next_due(nightly, autumn, BERLIN)
    assert next_due(nightly, first, BERLIN) - first == timedelta(hours=25)
    quarter = ScreeningSchedule(name="s", cron="*/15 * * * *")
    for begin in (spring, autumn):
        due_instants = due_between(quarter, begin, begin + timedelta(hours=8), BERLIN)
        assert (due_instants.count, due_instants.last) == (32, begin + timedelta(hours=8))


@given(st.integers(0, 20_000), st.sampled_from(["0 0 1 * *", "15 3 * * 1", "0 */6 * * *"]))
def test_every_reading_of_the_wall_clock_is_met(hours: int, cron: str) -> None:
    """Seen from any instant of two years, the next one is what looking at each minute finds."""
    after = NOON + timedelta(hours=hours)
    result = next_due(ScreeningSchedule(name="s", cron=cron), after, BERLIN)
    assert due_between(ScreeningSchedule(name="s", cron=cron), after, result, BERLIN).count == 1
    minute, hour, day, _, weekday = cron.split()
    place = result - timedelta(minutes=1)
    while place > max(after, result - timedelta(days=2)):
        wall = place.astimezone(ZoneInfo(BERLIN))
        missed = (
            wall.minute == int(minute)
            and (wall.hour % 6 == 0 if "/" in hour else wall.hour == int(hour))
            and day in ("*", str(wall.day))
            and weekday in ("*", str(wall.isoweekday()))
        )
        assert not missed
        place -= timedelta(minutes=1)


@given(
    every_s=st.floats(10.0, 90_000.0),
    after_s=st.floats(0, 1e7),
    length_s=st.floats(0, 1e6),
)
def test_intervals_do_not_depend_on_who_asks(every_s, after_s, length_s) -> None:
    """The last instant up to now is the one that stepping from instant to instant finds, and the
    next one is one interval later."""
    schedule = ScreeningSchedule(name="s", every_s=every_s)
    after = NOON + timedelta(seconds=after_s)
    until = after + timedelta(seconds=length_s)
    first = next_due(schedule, after, BERLIN)
    missed = due_between(schedule, after, until, BERLIN)
    if missed is None:
        assert first > until
        return
    assert first <= missed.last <= until
    assert missed.last > after
    step = (missed.last - first) / timedelta(seconds=every_s)
    assert step == pytest.approx(missed.count - 1, abs=1e-6)
    following = next_due(schedule, missed.last, BERLIN)
    assert following > until
    assert (following - missed.last).total_seconds() == pytest.approx(every_s, abs=1e-5)


def test_what_was_missed_is_counted() -> None:
    """All instants between two looks are found, also those of years."""
    hourly = ScreeningSchedule(name="s", cron="0 * * * *")
    missed = due_between(hourly, NOON, NOON + timedelta(hours=5, minutes=1), BERLIN)
    assert (missed.last, missed.count) == (NOON + timedelta(hours=5), 5)
    yearly = ScreeningSchedule(name="s", cron="0 0 1 1 *")
    due_instants = due_between(yearly, NOON, NOON + 800 * DAY, BERLIN)
    assert (local(due_instants.last), due_instants.count) == ("Sat 01.01. 00:00", 2)
    assert due_between(hourly, NOON, NOON + 100 * DAY, BERLIN).at_least


@settings(max_examples=25)
@given(st.text(min_size=1), st.floats(0, 86400), st.integers(0, 10**6))
def test_jitter_is_bounded_and_the_same_for_all(name: str, most_s: float, minute: int) -> None:
    """Two processes hold a run back by the same time, from nothing to what was asked."""
    schedule = ScreeningSchedule(name=name, every_s=60.0, jitter_s=most_s)
    due = NOON + timedelta(minutes=minute)
    assert timedelta(0) <= jitter(schedule, due) <= timedelta(seconds=most_s)
    assert jitter(schedule, due) == jitter(schedule, due)


def test_jitter_spreads_valves_that_are_due_together() -> None:
    """Ten schedules of one instant do not begin together."""
    due = [
        jitter(ScreeningSchedule(name=f"s{n}", every_s=60, jitter_s=600), NOON) for n in range(10)
    ]
    assert max(due) - min(due) > timedelta(seconds=120)
