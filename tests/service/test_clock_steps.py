"""The clock is set by hours or years, forward and back, while the service runs or is stopped."""

from __future__ import annotations

import os
import random
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import time_machine

from stemwatch.connectors.modbus.sample_batch import CAME_TWICE, SampleBatch, one_instant
from stemwatch.models.recording import Quality
from stemwatch.service.alerts.notifiers import NotSent
from stemwatch.service.alerts.sender import Sender
from stemwatch.service.alerts.silent_sources import watch_sources
from stemwatch.service.collector import Spool
from stemwatch.service.collector.forwarder import Forwarder
from stemwatch.service.config import Plant, load_plant
from stemwatch.service.scheduler import Scheduler
from stemwatch.service.serve.clock_watch import ClockWatch
from stemwatch.service.serve.health_checks import health_checks
from stemwatch.service.serve.periodic_tasks import periodic_tasks
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.runs.schedule import ScreeningSchedule
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.samples.tables import microseconds
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store, open_store
from stemwatch.service.watch import WatchedFolder
from tests.service.alerts.test_sender import Mailbox
from tests.service.open_alerts import open_alerts

START = datetime(2026, 3, 2, 12, 0, tzinfo=UTC)
HOUR, DAY = timedelta(hours=1), timedelta(days=1)
GOOD = np.zeros(1, np.uint8)
HOURLY = ScreeningSchedule(name="hourly", cron="0 * * * *", window_s=7200.0)
PLANT = """
[alerts]
silent_after_s = 300
[service]
keep_samples_days = 90
[[sources]]
name = "inbox"
folder = "inbox"
[[devices]]
name = "plc"
host = "192.0.2.1"
byte_order = "ABCD"
[[devices.registers]]
tag = "V1.OP"
register = "holding"
address = 0
type = "FLOAT32"
"""


class Clocks:
    """The wall clock, which can be set, beside time that only goes on."""

    def __init__(self, traveller: time_machine.Traveller) -> None:
        self._traveller = traveller
        self.steady_s = 0.0

    def pass_(self, time: timedelta) -> None:
        """Let time pass on both."""
        self.steady_s += time.total_seconds()
        self._traveller.shift(time)

    def set(self, by: timedelta) -> None:
        """Set the wall clock."""
        self._traveller.shift(by)


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Iterator[Clocks]:
    """Clocks that stand still until they are moved."""
    with time_machine.travel(START, tick=False) as traveller:
        result = Clocks(traveller)
        defaults = ClockWatch.__init__.__kwdefaults__
        monkeypatch.setitem(defaults, "steady_s", lambda: result.steady_s)
        yield result


@pytest.fixture
def plant(tmp_path: Path) -> Plant:
    """A device, and a folder that is watched."""
    (tmp_path / "plant.toml").write_text(PLANT, encoding="utf-8")
    return load_plant(tmp_path / "plant.toml", environment={})


@pytest.fixture
def store(tmp_path: Path, clocks: Clocks) -> Iterator[Store]:
    """An empty store."""
    with open_store(f"sqlite:///{tmp_path / 'store.db'}") as opened:
        yield opened


def polled(at: datetime, value: float) -> SampleBatch:
    """One tag's good sample."""
    return one_instant("plc", ["V1.OP"], microseconds(at), np.array([value]), GOOD, [""])


def collect(spool: Spool, store: Store, instants: list[datetime], first: int) -> None:
    """Poll at these instants, as the computer's clock says them; values count on from ``first``."""
    for number, at in enumerate(instants, start=first):
        spool.append(polled(at, float(number)))
    assert Forwarder(spool, store.samples).once()


def seconds(begin: datetime, count: int) -> list[datetime]:
    return [begin + timedelta(seconds=number) for number in range(count)]


@pytest.mark.parametrize("restarted", [False, True])
@pytest.mark.parametrize("step", [-HOUR, HOUR, -3 * HOUR, 3 * HOUR, timedelta(days=3650)])
def test_no_time_has_two_values_of_which_one_is_good(
    tmp_path: Path, store: Store, step: timedelta, restarted: bool
) -> None:
    """The clock is wrong for a minute and right again, seen by one process or by two: whatever came
    twice is bad and says why, all else is good."""
    spool = Spool(tmp_path / "spool")
    collect(spool, store, seconds(START, 60), 0)
    collect(spool, store, seconds(START + timedelta(seconds=60) + step, 60), 100)
    if restarted:
        spool.close()
        spool = Spool(tmp_path / "spool")
    collect(spool, store, seconds(START + timedelta(seconds=120), 30), 200)
    collect(spool, store, seconds(START + timedelta(seconds=60) + step, 30), 300)
    spool.close()
    samples = store.samples.read("plc", "V1.OP")
    twice = (samples.at_us >= microseconds(START + timedelta(seconds=60) + step)) & (
        samples.at_us < microseconds(START + timedelta(seconds=90) + step)
    )
    assert (samples.quality[twice] == Quality.MISSING).all()
    assert np.isnan(samples.values[twice]).all()
    assert (samples.quality[~twice] == Quality.GOOD).all()
    assert samples.at_us.size == 150
    assert store.samples.reasons("plc", "V1.OP") == {CAME_TWICE: 30}


def test_any_steps_of_the_clock_leave_no_wrong_value_good(tmp_path: Path, store: Store) -> None:
    """Polls with a clock that is set at random, on small numbers: every good value was the only one
    polled at its time, and no process that begins anew forgets it."""
    draw = random.Random(17)
    for turn in range(60):
        spool, answer = Spool(tmp_path / f"spool-{turn}"), dict[int, set[float]]()
        now, value = 1_000_000, 0.0
        for _ in range(draw.randrange(2, 6)):
            # Not by one second: no poll follows another with the same instant.
            step_s = draw.choice([n for n in range(-20, 20) if n != -1])
            now = max(now + step_s * draw.choice([1, 4000]) * 1_000_000, 0)
            for _ in range(draw.randrange(1, 15)):
                now, value = now + 1_000_000, value + 1.0
                spool.append(one_instant(f"plc {turn}", ["T"], now, np.array([value]), GOOD, [""]))
                answer.setdefault(now, set()).add(value)
            assert Forwarder(spool, store.samples).once()
            if draw.random() < 0.5:
                spool.close()
                spool = Spool(tmp_path / f"spool-{turn}")
        spool.close()
        samples = store.samples.read(f"plc {turn}", "T")
        assert samples.at_us.tolist() == sorted(answer)
        good = samples.quality == Quality.GOOD
        for at_us, item in zip(samples.at_us[good].tolist(), samples.values[good], strict=True):
            assert answer[at_us] == {item}, (turn, at_us)


def test_a_schedule_goes_on_when_the_clock_ran_ahead(store: Store, clocks: Clocks) -> None:
    """A day ahead for a moment: the run for an instant to come is skipped, the schedule does not
    rest for a day, and that instant has its own run when it comes."""
    store.schedules.take_from_file([HOURLY])
    scheduler = Scheduler(store, "UTC")
    scheduler.look()
    clocks.set(DAY)
    (early,) = scheduler.look()
    clocks.set(-DAY)
    assert scheduler.look() == []
    assert store.run(early).state is RunState.SKIPPED
    assert "ran ahead" in store.run(early).reason
    due = []
    for _ in range(26):
        clocks.pass_(HOUR)
        (number,) = scheduler.look()
        store.queue.finish(number, RunState.DONE)
        due.append(store.run(number).due)
    assert due == [START + n * HOUR for n in range(1, 27)]


def test_a_clock_that_is_corrected_by_minutes_repeats_no_run(store: Store, clocks: Clocks) -> None:
    """Two machines that serve one database may differ by so much."""
    store.schedules.take_from_file([HOURLY])
    scheduler = Scheduler(store, "UTC")
    clocks.pass_(HOUR)
    assert len(scheduler.look()) == 1
    clocks.set(timedelta(minutes=-5))
    assert scheduler.look() == []
    clocks.pass_(timedelta(minutes=6))
    assert scheduler.look() == []
    assert len(store.queue.recent()) == 1


def test_a_run_whose_worker_died_is_taken_over_after_the_clock_was_set_back(
    store: Store, clocks: Clocks
) -> None:
    """Its last sign of life lies in the future, and no living worker's does."""
    store.queue.put(RunToQueue(), software_version="1")
    clocks.set(5 * HOUR)
    run = store.queue.claim("a-worker-elsewhere")
    clocks.set(-5 * HOUR)
    accepted = store.queue.claim("another")
    assert accepted is not None
    assert accepted.id == run.id
    assert store.queue.claim("a-third") is None


def test_a_message_that_waits_is_sent_after_the_clock_was_set_back(
    store: Store, clocks: Clocks
) -> None:
    """Neither what is to be tried again nor what a dead process had taken waits for hours."""
    store.deliveries.put({"a": {"subject": "s"}, "b": {"subject": "s"}}, "k1", [])
    box = Mailbox()
    clocks.set(5 * HOUR)
    Sender(store, {"a": Mailbox(failures=1), "b": Mailbox(failures=1)}).send_due()
    store.deliveries.put({"c": {"subject": "s"}}, "k2", [])
    assert store.deliveries.claim() is not None
    clocks.set(-5 * HOUR)
    assert Sender(store, {"a": box, "b": box, "c": box}).send_due() == 3
    assert sorted(box.keys) == ["k1", "k1", "k2"]


def test_a_message_is_not_given_up_because_the_clock_leapt(store: Store, clocks: Clocks) -> None:
    """A week ahead, or a service that was off for a week: one failure is one failure."""
    store.deliveries.put({"a": {"subject": "s"}}, "k1", [])
    box = Mailbox(failures=1, error=NotSent("busy"))
    clocks.set(7 * DAY)
    sender = Sender(store, {"a": box})
    sender.send_due()
    clocks.pass_(timedelta(minutes=2))
    assert sender.send_due() == 1


def test_a_living_device_is_not_called_silent_when_the_clock_leaps(
    store: Store, plant: Plant, clocks: Clocks
) -> None:
    """Hours ahead: nothing of the last five minutes is there, and nobody is to blame."""
    clock = ClockWatch()
    clocks.pass_(HOUR)
    store.sources.note(SourceState(source="plc", kind="modbus", last_good=datetime.now(UTC)))
    assert watch_sources(store, plant, clock.even_since()) == []
    clocks.set(3 * HOUR)
    assert watch_sources(store, plant, clock.even_since()) == []
    clocks.pass_(timedelta(seconds=15))
    store.sources.note(SourceState(source="plc", kind="modbus", last_good=datetime.now(UTC)))
    clocks.pass_(timedelta(seconds=299))
    assert watch_sources(store, plant, clock.even_since()) == []


@pytest.mark.parametrize("step", [-5 * HOUR, 5 * HOUR])
def test_a_device_that_died_is_noticed_although_the_clock_was_set(
    store: Store, plant: Plant, clocks: Clocks, step: timedelta
) -> None:
    """The last good sample may lie in the future: that neither delays the alert nor ends it."""
    clock = ClockWatch()
    clocks.pass_(HOUR)
    store.sources.note(SourceState(source="plc", kind="modbus", last_good=datetime.now(UTC)))
    clocks.set(step)
    watch_sources(store, plant, clock.even_since())
    clocks.pass_(timedelta(seconds=301))
    assert len(watch_sources(store, plant, clock.even_since())) == 1
    watch_sources(store, plant, clock.even_since())
    assert len(open_alerts(store)) == 1


def test_a_dead_collector_is_seen_after_the_clock_was_set_back(
    store: Store, plant: Plant, clocks: Clocks
) -> None:
    """What it said last bears a time to come, which is no sign of life."""
    store.sources.note(SourceState(source="plc", kind="modbus"))
    clocks.set(-HOUR)
    scheduler = Scheduler(store, "UTC")
    checks = {check.name: check.ok for check in health_checks(store, plant, scheduler)}
    assert (checks["collector"], checks["device plc"]) == (False, False)


def test_an_export_from_the_future_is_read(store: Store, plant: Plant, clocks: Clocks) -> None:
    """Written before the clock was set back, or by a machine whose clock is ahead."""
    inbox = plant.beside("inbox")
    inbox.mkdir()
    (inbox / "export.csv").write_text("nothing of use\n", encoding="utf-8")
    later = (START + 3 * HOUR).timestamp()
    os.utime(inbox / "export.csv", (later, later))
    folder = WatchedFolder(plant, "inbox", store)
    assert folder.look() == []
    (file,) = folder.look()
    assert file.name == "export.csv"


def remove_old(store: Store, plant: Plant) -> None:
    """The task that removes old samples, as a service that begins now has it."""
    tasks = {name: task for name, _, task in periodic_tasks(store, plant, "me")}
    tasks["old samples"]()


@pytest.mark.parametrize("begun", ["before the step", "after it"])
def test_no_sample_goes_because_the_clock_leapt(
    store: Store, plant: Plant, clocks: Clocks, begun: str
) -> None:
    """Ten years ahead, every sample is too old. What is removed cannot come back, so nothing is
    until the clock has gone evenly for a day; what is old then goes."""
    store.samples.write(polled(START - HOUR, 50.0))
    store.samples.write(polled(START - 100 * DAY, 50.0))
    store.sources.note(SourceState(source="plc", kind="modbus"))
    tasks = {name: task for name, _, task in periodic_tasks(store, plant, "me")}
    clocks.set(3650 * DAY)
    if begun == "after it":
        tasks = {name: task for name, _, task in periodic_tasks(store, plant, "me")}
    tasks["old samples"]()
    clocks.pass_(23 * HOUR)
    tasks["old samples"]()
    assert store.samples.read("plc", "V1.OP").at_us.size == 2
    clocks.set(-3650 * DAY)
    tasks["old samples"]()
    assert store.samples.read("plc", "V1.OP").at_us.size == 2
    clocks.pass_(25 * HOUR)
    tasks["old samples"]()
    assert store.samples.read("plc", "V1.OP").at_us.tolist() == [microseconds(START - HOUR)]


def test_old_samples_go_at_once_where_nothing_is_wrong(
    store: Store, plant: Plant, clocks: Clocks
) -> None:
    """After a weekend without service, old samples are removed without waiting a day."""
    store.samples.write(polled(START - 100 * DAY, 50.0))
    store.sources.note(SourceState(source="plc", kind="modbus"))
    clocks.pass_(3 * DAY)
    remove_old(store, plant)
    assert store.samples.read("plc", "V1.OP").at_us.size == 0
