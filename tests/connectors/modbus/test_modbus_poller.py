"""Polling: every instant yields a sample for each tag, whatever the device does."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable

import numpy as np
import pytest
from pymodbus.constants import ExcCodes

from stemwatch.connectors.modbus.blocks import FORGET_S, REST_S, BlockPlan
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType
from stemwatch.connectors.modbus.device import Device
from stemwatch.connectors.modbus.poller import NOT_POLLED, DevicePoller
from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.models.recording import Quality
from tests.connectors.modbus.loopback_servers import (
    Behaviour,
    device,
    register,
    serving,
    sim_device,
    tcp,
)

EVERY_S = 0.1


class Polled:
    """A poller that runs, and what it has delivered."""

    def __init__(self, plc: Device) -> None:
        self.batches: list[SampleBatch] = []
        self.poller = DevicePoller(plc, self.batches.append)

    @property
    def polled(self) -> list[SampleBatch]:
        """The batches of instants that were kept: a busy computer may miss one."""
        return [batch for batch in self.batches if NOT_POLLED not in batch.reasons]

    async def until(self, met: Callable[[SampleBatch], bool], patience_s: float = 20.0) -> int:
        """Wait for a new batch that is as wanted; its place."""
        place = len(self.batches)
        async with asyncio.timeout(patience_s):
            while True:
                while place < len(self.batches):
                    if met(self.batches[place]):
                        return place
                    place += 1
                await asyncio.sleep(0.02)


async def polling(plc: Device, story: Callable[[Polled], Awaitable[None]]) -> Polled:
    """Run ``story`` beside a poller of ``plc``."""
    polled = Polled(plc)
    task = asyncio.create_task(polled.poller.run())
    try:
        await story(polled)
    finally:
        task.cancel()
        await asyncio.wait([task])
    assert task.cancelled()  # and did not end by itself
    return polled


def all_good(batch: SampleBatch) -> bool:
    """Every sample is good."""
    return batch.good == len(batch)


def because(reason: str) -> Callable[[SampleBatch], bool]:
    """Every sample is bad for a reason that begins so."""
    return lambda batch: all(each.startswith(reason) for each in batch.reasons)


def even(batches: list[SampleBatch], every_s: float = EVERY_S) -> None:
    """The batches lie on the grid of the interval, in order, without a hole or a repetition."""
    times = np.array([batch.at_us[0] for batch in batches])
    assert set(np.diff(times).tolist()) <= {round(every_s * 1e6)}
    assert (times % round(every_s * 1e6) == 0).all()


def test_values_arrive_in_engineering_units_on_an_even_clock() -> None:
    """Two tables and two units in one batch; the instants are whole multiples of the interval."""
    first = Behaviour(holding={0: 0x8000, 1: 0xC216, 10: 250})
    second = Behaviour(holding={0: 7})
    registers = [
        register("PV", 0, DataType.FLOAT32, order=ByteOrder.CDAB),
        register("ZT", 10, scale=0.1),
        register("OTHER", 0, unit_id=2),
    ]

    async def run() -> Polled:
        async with serving(sim_device(1, first), sim_device(2, second)) as served:
            plc = device(tcp(served.port), *registers, every_s=EVERY_S)

            async def story(polled: Polled) -> None:
                await polled.until(lambda _: len(polled.batches) >= 5)

            return await polling(plc, story)

    polled = asyncio.run(run())
    even(polled.batches)
    for batch in polled.polled:
        assert batch.tags == ("PV", "ZT", "OTHER")
        assert batch.values.tolist() == [-37.625, 25.0, 7.0]
        assert batch.reasons == ("", "", "")


def test_a_refused_register_costs_itself_only_and_is_remembered() -> None:
    """The block is split until one register is left over, and asked for whole no more."""
    behaviour = Behaviour(
        holding={i: i for i in range(100)}, refuses={37: ExcCodes.ILLEGAL_ADDRESS}
    )

    async def run() -> tuple[Polled, int, int]:
        async with serving(sim_device(1, behaviour)) as served:
            registers = [register(f"T{i}", i) for i in range(100)]
            plc = device(tcp(served.port), *registers, every_s=EVERY_S)
            asked = 0

            async def story(polled: Polled) -> None:
                nonlocal asked
                await polled.until(lambda batch: batch.good == 99)
                asked = len(behaviour.asked)
                place = await polled.until(lambda batch: batch.good == 99)
                await polled.until(lambda _: len(polled.batches) >= place + 4)

            polled = await polling(plc, story)
            return polled, asked, len(behaviour.asked)

    polled, first, total = asyncio.run(run())
    for batch in polled.polled:
        (bad,) = [i for i in range(100) if batch.reasons[i]]
        assert (batch.tags[bad], batch.quality[bad]) == ("T37", Quality.BAD)
        assert batch.reasons[bad] == "exception 2 (illegal data address)"
        assert batch.values[:37].tolist() == list(range(37))
    assert polled.poller.state.refused == ("T37",)
    assert polled.poller.state.fault == ""
    later = (total - first) / (len(polled.polled) - 1)
    assert first > 10
    assert later < first * 0.8


def test_a_device_that_allows_few_registers_at_once_is_split() -> None:
    """Exception 3 for anything above 10 words, as some devices answer."""
    plan = BlockPlan(device(tcp(1), *[register(f"T{i}", i) for i in range(40)]).blocks())
    while any(block.count > 10 for block in plan.blocks()):
        block = next(block for block in plan.blocks() if block.count > 10)
        assert len(plan.split(block)) == 2
    assert [block.count for block in plan.blocks()] == [10, 10, 10, 10]


def test_what_was_split_or_refused_is_tried_again_later() -> None:
    """A controller that is being programmed refuses everything for a while."""
    from stemwatch.connectors.modbus.read_fault import refused

    now_s = 0.0
    plan = BlockPlan(
        device(tcp(1), *[register(f"T{i}", i) for i in range(4)]).blocks(), lambda: now_s
    )
    (complete,) = plan.blocks()
    left, _ = plan.split(complete)
    plan.rest(left, refused(2))
    now_s = REST_S - 1
    assert plan.resting(left) is not None
    assert plan.refused == ("T0", "T1")
    now_s = REST_S + 1
    assert plan.resting(left) is None
    assert len(plan.blocks()) == 2
    now_s = FORGET_S + 1
    assert plan.blocks() == (complete,)


@pytest.mark.parametrize(
    ("exception", "reason"),
    [
        (ExcCodes.DEVICE_BUSY, "exception 6 (device busy)"),
        (ExcCodes.DEVICE_FAILURE, "exception 4 (device failure)"),
    ],
)
def test_an_exception_marks_the_samples_and_passes(exception: ExcCodes, reason: str) -> None:
    """Bad with its reason while it lasts, good right after."""
    behaviour = Behaviour(holding={0: 5})

    async def run() -> Polled:
        async with serving(sim_device(1, behaviour)) as served:
            plc = device(tcp(served.port), register("T", 0), every_s=EVERY_S)

            async def story(polled: Polled) -> None:
                await polled.until(all_good)
                behaviour.exception = exception
                place = await polled.until(because(reason))
                assert polled.batches[place].quality[0] == Quality.BAD
                assert math.isnan(polled.batches[place].values[0])
                assert polled.poller.state.fault == reason
                behaviour.exception = None
                await polled.until(all_good)

            return await polling(plc, story)

    even(asyncio.run(run()).batches)


def test_a_silent_device_leaves_no_hole_in_time_and_comes_back() -> None:
    """Answers later than the timeout, for longer than an interval: every instant has its sample."""
    behaviour = Behaviour(holding={0: 5})

    async def run() -> Polled:
        async with serving(sim_device(1, behaviour)) as served:
            plc = device(tcp(served.port, timeout_s=0.5), register("T", 0), every_s=EVERY_S)

            async def story(polled: Polled) -> None:
                await polled.until(all_good)
                behaviour.delay_s = 1.0
                place = await polled.until(because("no answer within 0.5 s"))
                assert polled.batches[place].quality[0] == Quality.MISSING
                await polled.until(because(NOT_POLLED))
                behaviour.delay_s = 0.0
                await polled.until(all_good)

            return await polling(plc, story)

    polled = asyncio.run(run())
    even(polled.batches)
    assert polled.poller.state.missed >= 1


def test_a_dead_unit_does_not_take_the_others_with_it() -> None:
    """Two units on one line: the living one is read while the dead one is left alone."""
    living, dead = Behaviour(holding={0: 5}), Behaviour(delay_s=60.0)

    async def run() -> Polled:
        async with serving(sim_device(1, living), sim_device(2, dead)) as served:
            registers = (register("DEAD", 0, unit_id=2), register("LIVING", 0))
            plc = device(tcp(served.port, timeout_s=0.5), *registers, every_s=0.3)

            async def story(polled: Polled) -> None:
                for _ in range(12):
                    await polled.until(lambda batch: batch.reasons[1] == "")

            return await polling(plc, story)

    polled = asyncio.run(run())
    even(polled.batches, 0.3)
    assert all(batch.reasons[0] for batch in polled.batches)
    living_share = np.mean([batch.reasons[1] == "" for batch in polled.batches])
    assert living_share > 0.5


def test_a_server_that_stops_and_starts_is_found_again() -> None:
    """Bad with a reason while it is away; times before and after are untouched."""
    behaviour = Behaviour(holding={0: 5})

    async def run() -> Polled:
        async with serving(sim_device(1, behaviour)) as served:
            plc = device(tcp(served.port), register("T", 0), every_s=EVERY_S)

            async def story(polled: Polled) -> None:
                await polled.until(all_good)
                await served.stop()
                place = await polled.until(because("no connection: "))
                assert polled.batches[place].quality[0] == Quality.MISSING
                async with serving(sim_device(1, behaviour), port=served.port):
                    await polled.until(all_good)

            return await polling(plc, story)

    polled = asyncio.run(run())
    even(polled.batches)
    assert polled.poller.state.reconnects == 2
    assert polled.poller.state.good + polled.poller.state.bad == len(polled.batches)


def test_connections_that_are_cut_again_and_again_are_made_again() -> None:
    """The wait between attempts grows, and shrinks once words have come."""
    behaviour = Behaviour(holding={0: 5})

    async def run() -> Polled:
        async with serving(sim_device(1, behaviour)) as served:
            plc = device(tcp(served.port), register("T", 0), every_s=EVERY_S)

            async def story(polled: Polled) -> None:
                for _ in range(3):
                    await polled.until(all_good)
                    served.cut()
                    await polled.until(because("no connection"))
                await polled.until(all_good)

            return await polling(plc, story)

    even(asyncio.run(run()).batches)


def test_one_device_that_hangs_costs_the_others_nothing() -> None:
    """Each device has a connection and a schedule of its own."""
    fine, hanging = Behaviour(holding={0: 5}), Behaviour(delay_s=30.0)

    async def run() -> tuple[Polled, Polled]:
        async with serving(sim_device(1, fine)) as item, serving(sim_device(1, hanging)) as other:
            quick = device(tcp(item.port), register("T", 0), every_s=EVERY_S)
            slow = device(tcp(other.port, timeout_s=20.0), register("T", 0), every_s=EVERY_S)
            stuck = Polled(slow)
            task = asyncio.create_task(stuck.poller.run())

            async def story(polled: Polled) -> None:
                for _ in range(10):
                    await polled.until(all_good)

            result = await polling(quick, story)
            task.cancel()
            await asyncio.wait([task])
            return result, stuck

    result, stuck = asyncio.run(run())
    assert all(all_good(batch) for batch in result.polled)
    assert stuck.batches == []


def test_what_nobody_thought_of_costs_one_poll(monkeypatch: pytest.MonkeyPatch) -> None:
    """An unforeseen exception affects one poll and does not end polling."""
    from stemwatch.connectors.modbus.block_reader import BlockReader

    behaviour = Behaviour(holding={0: 5})
    right = BlockReader.read

    def wrong(self, words, into):
        raise ZeroDivisionError("a mistake")

    async def run() -> Polled:
        async with serving(sim_device(1, behaviour)) as served:
            plc = device(tcp(served.port), register("T", 0), every_s=EVERY_S)

            async def story(polled: Polled) -> None:
                await polled.until(all_good)
                monkeypatch.setattr(BlockReader, "read", wrong)
                await polled.until(because("unforeseen: ZeroDivisionError"))
                monkeypatch.setattr(BlockReader, "read", right)
                await polled.until(all_good)

            return await polling(plc, story)

    even(asyncio.run(run()).batches)


def test_a_cancellation_in_the_moment_of_an_answer_is_not_forgotten(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Before Python 3.12 waiting for an answer can swallow it; the poller ends all the same."""
    from stemwatch.connectors.modbus.connection import Connection

    asked = asyncio.Event()

    async def swallow(self, unit_id, table, first, count):
        asked.set()
        try:
            await asyncio.sleep(30)
        except asyncio.CancelledError:
            return [5] * count
        raise AssertionError("nobody cancelled")

    async def run() -> bool:
        async with serving(sim_device(1, Behaviour())) as served:
            monkeypatch.setattr(Connection, "read", swallow)
            plc = device(tcp(served.port), register("T", 0), every_s=EVERY_S)
            task = asyncio.create_task(DevicePoller(plc, lambda batch: None).run())
            await asked.wait()
            task.cancel()
            done, _ = await asyncio.wait([task], timeout=10)
            return task in done and task.cancelled()

    assert asyncio.run(run())
