"""The schedule does not drift, begins no poll late, and survives a clock that is set."""

from __future__ import annotations

import asyncio
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.connectors.modbus.poll_schedule import PollSchedule, Slot

EVERY_S = st.sampled_from([0.1, 0.25, 0.5, 1.0, 3.0, 10.0])


@given(EVERY_S, st.integers(0, 10**16), st.lists(st.integers(0, 30_000_000), max_size=40))
def test_slots_and_misses_cover_the_time_without_overlap(every_s, start_us, steps) -> None:
    """Whatever a poll takes, each multiple of the interval is a slot or missed, once, in order."""
    schedule = PollSchedule(every_s)
    now_us = start_us
    seen: list[int] = []
    for step_us in steps:
        slot = schedule.plan(now_us)
        assert not slot.clock_went_back
        assert now_us - slot.at_us <= min(schedule.every_us / 2, 250_000)
        seen += [*slot.missed_us, slot.at_us]
        now_us = max(now_us, slot.at_us) + step_us
    assert all(at_us % schedule.every_us == 0 for at_us in seen)
    assert seen == list(range(min(seen, default=0), max(seen, default=-1) + 1, schedule.every_us))


def test_slots_lie_on_a_grid_that_does_not_depend_on_the_start() -> None:
    """Two devices, or one before and after a restart, share their instants."""
    assert PollSchedule(0.5).plan(1_700_000_000_400_000).at_us == 1_700_000_000_500_000
    assert PollSchedule(0.5).plan(1_700_000_000_499_999).at_us == 1_700_000_000_500_000


def test_a_poll_that_ends_late_misses_what_it_covered() -> None:
    """2.4 s at an interval of 1 s: two instants are gone, the third is kept."""
    schedule = PollSchedule(1.0)
    schedule.plan(10_000_000)
    slot = schedule.plan(12_400_000)
    assert (list(slot.missed_us), slot.at_us) == ([11_000_000, 12_000_000], 13_000_000)


def test_a_poll_may_begin_a_little_late() -> None:
    """After 1.2 s the next instant, 0.2 s ago, is still kept."""
    schedule = PollSchedule(1.0)
    schedule.plan(10_000_000)
    slot = schedule.plan(11_200_000)
    assert (list(slot.missed_us), slot.at_us) == ([], 11_000_000)


def test_a_clock_set_back_is_said_and_lived_with() -> None:
    """An hour back: polling goes on at once, at times that come a second time."""
    schedule = PollSchedule(1.0)
    schedule.plan(7_200_000_000)
    slot = schedule.plan(3_600_000_000)
    assert slot.clock_went_back
    assert slot.at_us == 3_600_000_000
    assert not schedule.plan(3_600_500_000).clock_went_back


def test_a_clock_corrected_a_little_repeats_nothing() -> None:
    """Half an interval back is waited for."""
    schedule = PollSchedule(1.0)
    schedule.plan(10_000_000)
    assert schedule.plan(9_600_000).at_us == 11_000_000


def test_waiting_returns_at_the_slot_never_before() -> None:
    """On the real clock, and without an error that adds up."""

    async def three() -> list[tuple[int, int]]:
        schedule = PollSchedule(0.1)
        matching = []
        for _ in range(3):
            slot = await schedule.next()
            matching.append((slot.at_us, time.time_ns() // 1000))
        return matching

    process = asyncio.run(three())
    assert all(now_us >= at_us for at_us, now_us in process)
    assert process[2][0] > process[0][0]


@pytest.mark.parametrize("back_s", [30, 3600])
def test_a_clock_set_back_during_the_wait_does_not_stop_the_polling(back_s: int) -> None:
    """The wait is planned anew instead of lasting an hour."""
    offset_ns = 0

    async def run() -> int:
        nonlocal offset_ns
        schedule = PollSchedule(0.2, lambda: time.time_ns() + offset_ns)
        await schedule.next()
        waiting = asyncio.create_task(schedule.next())
        await asyncio.sleep(0.01)
        offset_ns = -back_s * 1_000_000_000
        slot = await asyncio.wait_for(waiting, timeout=20)
        return schedule.now_us() - slot.at_us

    assert 0 <= asyncio.run(run()) < 10_000_000


def test_an_instant_that_was_slept_through_is_missed_and_not_polled_late(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The process or its machine stood still for five seconds: what is read then is of another
    instant, and would be a good sample of a wrong one."""
    now_ns = [1_700_000_000_060_000_000]
    stands_still_ns = [0, 5_000_000_000]

    async def sleep(seconds: float) -> None:
        now_ns[0] += round(seconds * 1e9) + (stands_still_ns.pop(0) if stands_still_ns else 0)

    monkeypatch.setattr("stemwatch.connectors.modbus.poller.asyncio.sleep", sleep)
    schedule = PollSchedule(0.1, lambda: now_ns[0])

    async def slots() -> list[Slot]:
        return [await schedule.next() for _ in range(3)]

    first, second, third = asyncio.run(slots())
    assert first.at_us == 1_700_000_000_100_000
    assert second.at_us == 1_700_000_005_200_000
    assert second.missed_us == range(1_700_000_000_200_000, 1_700_000_005_200_000, 100_000)
    assert third.at_us - second.at_us == 100_000
    assert not third.missed_us
