"""Planning: every instant is accounted for, whatever the service missed."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
import time_machine

from stemwatch.service.scheduler import Scheduler
from stemwatch.service.store.runs.schedule import ScreeningSchedule
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store, open_store

START = datetime(2026, 3, 2, 12, 0, 30, tzinfo=UTC)
HOURLY = ScreeningSchedule(name="hourly", cron="0 * * * *", window_s=7200.0)


@pytest.fixture
def clock() -> Iterator[time_machine.Traveller]:
    """A clock that stands still at ``START`` until it is moved."""
    with time_machine.travel(START, tick=False) as traveller:
        yield traveller


@pytest.fixture
def store(tmp_path: Path, clock: time_machine.Traveller) -> Iterator[Store]:
    """An empty store with one hourly schedule."""
    with open_store(f"sqlite:///{tmp_path / 'store.db'}") as opened:
        opened.schedules.take_from_file([HOURLY])
        yield opened


@pytest.fixture
def scheduler(store: Store) -> Scheduler:
    """A scheduler in UTC, which looks when it is asked to."""
    return Scheduler(store, "UTC")


def test_nothing_is_due_before_its_instant(store: Store, scheduler: Scheduler) -> None:
    """A new schedule begins with its next instant, which is shown."""
    assert scheduler.look() == []
    (kept,) = store.schedules.all()
    assert kept.next_due == START.replace(hour=13, second=0)


def test_a_run_has_the_window_before_its_instant(store: Store, scheduler: Scheduler, clock) -> None:
    """The window ends at the instant itself, not when somebody got round to it."""
    clock.shift(timedelta(hours=1, seconds=20))
    (number,) = scheduler.look()
    run = store.run(number)
    due = START.replace(hour=13, second=0)
    assert (run.due, run.window) == (due, (due - timedelta(hours=2), due))
    assert scheduler.look() == []


def test_a_schedule_that_cannot_be_planned_keeps_no_other_from_running(
    store: Store, scheduler: Scheduler, clock
) -> None:
    """An earlier version took a window that begins before the calendar does."""
    store.schedules.set(ScreeningSchedule(name="all", cron="0 * * * *", window_s=1e12))
    clock.shift(timedelta(hours=1, seconds=20))
    with pytest.raises(OverflowError) as raised:
        scheduler.look()
    assert raised.value.__notes__ == ["schedule all"]
    (run,) = store.queue.recent()
    assert run.schedule == "hourly"


@pytest.mark.parametrize(
    ("hours", "said"),
    [
        (60, "59 instants before it had been missed; this run makes up for them"),
        (2, "1 instant before it had been missed; this run makes up for it"),
    ],
)
def test_missed_instants_are_made_up_for_by_one_run(
    store: Store, scheduler: Scheduler, clock, hours: int, said: str
) -> None:
    """After a weekend without service there is one run, which says how many it stands for."""
    clock.shift(timedelta(hours=hours))
    (number,) = scheduler.look()
    assert store.run(number).reason == said
    assert len(store.queue.recent()) == 1


def test_two_services_queue_an_instant_once(store: Store, scheduler: Scheduler, clock) -> None:
    """The second one finds that the first was there."""
    clock.shift(timedelta(hours=1))
    assert len(scheduler.look()) == 1
    store.schedules.note("hourly", START, None)  # as if the second had read before the first wrote
    assert Scheduler(store, "UTC").look() == []


def test_an_instant_during_a_run_is_accounted_for(
    store: Store, scheduler: Scheduler, clock
) -> None:
    """While a run goes on, the instants of its schedule are noted as skipped."""
    for _ in range(3):
        clock.shift(timedelta(hours=1))
        scheduler.look()
        store.queue.claim("w")
    states = [run.state for run in store.queue.recent()]
    assert states == [RunState.SKIPPED, RunState.SKIPPED, RunState.RUNNING]


def test_a_resting_schedule_owes_nothing(store: Store, scheduler: Scheduler, clock) -> None:
    """What passes while a schedule is off is not made up for when it is on again."""
    resting = ScreeningSchedule(name="hourly", cron="0 * * * *", window_s=7200.0, enabled=False)
    store.schedules.take_from_file([resting])
    clock.shift(timedelta(hours=5))
    assert scheduler.look() == []
    store.schedules.take_from_file([HOURLY])
    assert scheduler.look() == []
    clock.shift(timedelta(hours=1))
    assert len(scheduler.look()) == 1


def test_a_changed_rhythm_begins_now(store: Store, scheduler: Scheduler, clock) -> None:
    """A schedule with another rhythm in the file owes no instants from before the change."""
    clock.shift(timedelta(hours=5))
    store.schedules.take_from_file([ScreeningSchedule(name="hourly", every_s=600.0)])
    assert scheduler.look() == []
    clock.shift(timedelta(minutes=10))
    assert len(scheduler.look()) == 1


@pytest.mark.parametrize(
    ("night", "hours"),
    [(datetime(2026, 3, 28, 20, tzinfo=UTC), 23), (datetime(2026, 10, 24, 20, tzinfo=UTC), 25)],
)
def test_the_nights_in_which_clocks_change(
    store: Store, clock, night: datetime, hours: int
) -> None:
    """The day of Berlin has 23 or 25 hours, each with its run; the run of 02:30, a time that spring
    leaves out and autumn repeats, is there once; windows are as long as ever."""
    clock.move_to(night)
    nightly = ScreeningSchedule(name="nightly", cron="30 2 * * *", window_s=7200.0)
    store.schedules.take_from_file([HOURLY, nightly])
    scheduler = Scheduler(store, "Europe/Berlin")
    for _ in range(28 * 6):
        for number in scheduler.look():
            store.queue.finish(number, RunState.DONE)
        clock.shift(timedelta(minutes=10))
    runs = [run for run in store.queue.recent() if run.due > night]
    sunday = (night + timedelta(hours=12)).date()
    zone = ZoneInfo("Europe/Berlin")
    of_day = [run for run in runs if run.due.astimezone(zone).date() == sunday]
    assert len([run for run in of_day if run.schedule == "hourly"]) == hours
    assert len([run for run in of_day if run.schedule == "nightly"]) == 1
    assert {run.reason for run in runs} == {""}
    assert {run.window[1] - run.window[0] for run in runs} == {timedelta(hours=2)}


def test_it_wakes_for_schedules_that_come_and_go(tmp_path: Path) -> None:
    """On the real clock: a schedule that is added is taken over without a restart, and one that is
    removed is not woken for any more."""
    import threading

    with open_store(f"sqlite:///{tmp_path / 'store.db'}") as store:
        queued = threading.Event()
        scheduler = Scheduler(store, "UTC", queued.set, longest_pause_s=0.2)
        scheduler.start()
        try:
            store.schedules.take_from_file([ScreeningSchedule(name="quick", every_s=1.0)])
            assert queued.wait(timeout=20)
            store.schedules.take_from_file([])
            scheduler.look()
            count = len(store.queue.recent())
            queued.clear()
            assert not queued.wait(timeout=1.5)
            assert len(store.queue.recent()) == count
        finally:
            scheduler.stop()
