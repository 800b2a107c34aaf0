"""The queue of runs: each instant once, each run worked on by one, nothing lost by a death."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime, timedelta

import pytest

from stemwatch.models.screening_result import Screening
from stemwatch.service.store.runs import leases, queue
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.screenings.records import RunState, ValveState
from stemwatch.service.store.store import Store, open_store

DUE = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
NOT_AT_ALL = timedelta(0)


def put(store: Store, **wanted) -> int | None:
    return store.queue.put(RunToQueue(**wanted), software_version="1")


def test_two_services_never_get_the_same_run(store: Store, store_url: str) -> None:
    """Many workers of two processes' stores share a queue, and each run goes to one of them."""
    for minute in range(24):
        put(store, schedule=f"s{minute}", due=DUE)
    with closing(open_store(store_url)) as other, ThreadPoolExecutor(8) as pool:
        stores = [store, other] * 16
        claimed = list(pool.map(lambda item: item[1].queue.claim(f"w{item[0]}"), enumerate(stores)))
    counts = Counter(run.id for run in claimed if run is not None)
    assert len(counts) == 24
    assert set(counts.values()) == {1}


def test_an_instant_of_a_schedule_is_queued_once(store: Store) -> None:
    """Two services that see the same instant queue one run; asked by people there is no limit."""
    first = put(store, schedule="daily", due=DUE)
    assert put(store, schedule="daily", due=DUE) is None
    assert put(store, who="Ann") != put(store, who="Ann")
    assert [run.id for run in store.queue.recent(schedule="daily")] == [first]


def test_a_schedule_does_not_overlap_itself(store: Store) -> None:
    """While its run goes on, the next instant is noted as skipped with the reason."""
    first = put(store, schedule="hourly", due=DUE)
    store.queue.claim("a")
    put(store, schedule="hourly", due=DUE + timedelta(hours=1))
    later, _ = store.queue.recent(schedule="hourly")
    assert later.state is RunState.SKIPPED
    assert f"run {first}" in later.reason
    assert later.finished is not None
    assert store.queue.claim("b") is None


def test_a_run_waits_for_its_instant(store: Store) -> None:
    """Jitter holds a run back, and it is not handed out before."""
    put(store, schedule="s", due=DUE, not_before=datetime.now(UTC) + timedelta(hours=1))
    assert store.queue.claim("a") is None


def test_a_silent_worker_loses_its_run_and_a_living_one_keeps_it(store: Store) -> None:
    """A run is taken over when its worker has said nothing for a while; the old worker is told."""
    put(store, who="Ann")
    run = store.queue.claim("dead")
    assert store.queue.claim("next") is None
    accepted = store.queue.claim("next", silent_after=NOT_AT_ALL)
    assert (accepted.id, accepted.started) == (run.id, run.started)
    assert store.queue.beat(run.id, "dead") is None
    assert store.queue.beat(run.id, "next").id == run.id


def test_a_run_that_is_left_is_taken_at_once(store: Store) -> None:
    """A service that stops in order keeps nobody waiting for its silence."""
    put(store, who="Ann")
    run = store.queue.claim("stops")
    store.queue.leave(run.id, "stops")
    assert store.queue.claim("next").id == run.id


def test_planning_again_gives_what_is_left(store: Store) -> None:
    """The second process does the valves that the first had not done, and counts none twice."""
    run = put(store, who="Ann")
    assert store.queue.plan(run, ["B", "A", "C", "A"]) == ["A", "B", "C"]
    store.queue.mark(run, "A", ValveState.DONE)
    store.queue.mark(run, "A", ValveState.SET_ASIDE, "a second time changes nothing")
    store.queue.mark(run, "C", ValveState.SET_ASIDE, "no result after 5 s")
    assert store.queue.plan(run, ["A", "B", "C"]) == ["B"]
    process = store.run(run)
    assert (process.total, process.done, process.set_aside) == (3, 2, 1)
    assert store.queue.set_aside(run) == [("C", "no result after 5 s")]
    assert store.queue.valves_done(run) == ["A"]


def test_cancelling_ends_a_waiting_run_at_once_and_a_running_one_soon(store: Store) -> None:
    """A waiting run is over at once, one that goes on when its worker hears; a finished one not."""
    first, second = put(store, who="Ann"), put(store, who="Ann")
    going = store.queue.claim("w")
    assert going.id == first
    assert store.queue.ask_to_cancel(first, "Ben")
    assert store.queue.ask_to_cancel(second, "Ben")
    assert store.queue.beat(first, "w").cancel_asked_by == "Ben"
    assert store.run(second).state is RunState.CANCELLED
    store.queue.finish(first, RunState.CANCELLED, reason="cancelled by Ben after 0 of 0 valves")
    assert not store.queue.ask_to_cancel(first, "Ben")
    assert not store.queue.ask_to_cancel(999, "Ben")


def test_the_time_left_follows_from_the_valves_done(store: Store) -> None:
    """Seconds to go follow from the valves that are done, and nothing is said before the first."""
    run_id = put(store, who="Ann")
    run = store.queue.claim("w")
    store.queue.plan(run_id, ["A", "B", "C", "D"])
    assert store.run(run_id).left_s(run.started) is None
    store.queue.mark(run_id, "A", ValveState.DONE)
    in_ten = run.started + timedelta(seconds=10)
    assert store.run(run_id).left_s(in_ten) == pytest.approx(30.0)


def test_the_end_counts_verdicts(store: Store, make_screening) -> None:
    """A run that is over knows its verdicts, its report and how it ended."""
    run_id = put(store, who="Ann")
    store.queue.claim("w")
    screening: Screening = make_screening()
    store.save(screening, run_id)
    result = store.queue.finish(run_id, RunState.DONE, report="reports/run-1")
    assert dict(result.counts) == {screening.verdict: 1}
    assert (result.state, result.report) == (RunState.DONE, "reports/run-1")
    assert store.queue.going() == []


def test_a_lease_has_one_holder(store: Store, store_url: str) -> None:
    """A duty goes to one process until it gives it back or falls silent."""
    leases = store.leases
    assert leases.hold("service", "a", timedelta(minutes=1))
    assert not leases.hold("service", "b", timedelta(minutes=1))
    assert leases.hold("service", "a", NOT_AT_ALL)
    assert leases.hold("service", "b", timedelta(minutes=1))
    assert leases.holder("service") == "b"
    leases.release("service", "b")
    assert leases.holder("service") is None


def test_schedules_of_the_file_follow_the_file(store: Store) -> None:
    """A schedule that goes from the file goes; one that stays keeps how far it has got; another
    rhythm begins anew."""
    from stemwatch.service.store.runs.schedule import ScreeningSchedule

    daily, hourly = (
        ScreeningSchedule(name="daily", cron="0 5 * * *"),
        ScreeningSchedule(name="h", every_s=3600.0),
    )
    store.schedules.take_from_file([daily, hourly])
    store.schedules.note("daily", DUE, DUE)
    store.schedules.note("h", DUE, DUE)
    store.schedules.take_from_file([daily, ScreeningSchedule(name="h", every_s=1800.0)])
    kept = {schedule.schedule.name: schedule for schedule in store.schedules.all()}
    assert (kept["daily"].last_due, kept["h"].last_due) == (DUE, None)
    store.schedules.take_from_file([daily])
    assert [schedule.schedule.name for schedule in store.schedules.all()] == ["daily"]


def test_a_run_whose_process_was_killed_is_taken_over_at_once(store: Store, monkeypatch) -> None:
    """It waits for nobody; the run of a process that may live waits until that has been silent."""
    removed, alive = put(store, who="Ann"), put(store, who="Ann")
    store.queue.claim("killed")
    store.queue.claim("alive")
    monkeypatch.setattr(queue, "has_ended", lambda owner: owner == "killed")
    assert store.queue.claim("next").id == removed
    assert store.queue.claim("next") is None
    assert store.queue.beat(alive, "alive") is not None


def test_a_run_of_a_killed_command_is_over(store: Store, monkeypatch) -> None:
    """Noted when the next run begins or the queue is looked at; one that may go on is left alone
    for a day."""
    killed = store.begin_run(software_version="1", owner="killed")
    alive = store.begin_run(software_version="1", owner="elsewhere")
    monkeypatch.setattr(queue, "has_ended", lambda owner: owner == "killed")
    assert store.queue.claim("a service") is None
    assert store.run(killed).state is RunState.FAILED
    assert "its process ended before the run was over" in store.run(killed).reason
    assert store.run(alive).state is RunState.RUNNING
    monkeypatch.setattr(queue, "LOST_AFTER", NOT_AT_ALL)
    store.begin_run(software_version="1", owner="third")
    assert store.run(alive).state is RunState.FAILED
    store.finish_run(alive)
    assert store.run(alive).state is RunState.DONE


def test_a_duty_of_a_killed_process_is_free(store: Store, monkeypatch) -> None:
    """Nobody waits for the end of its lease, and nobody takes it for one that serves."""
    assert store.leases.hold("service", "killed", timedelta(minutes=1))
    assert not store.leases.hold("service", "next", timedelta(minutes=1))
    monkeypatch.setattr(leases, "has_ended", lambda owner: owner == "killed")
    assert store.leases.holder("service") is None
    assert store.leases.hold("service", "next", timedelta(minutes=1))
