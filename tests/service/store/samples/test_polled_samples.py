"""What a Modbus device gave to its poller, as a recording from the store."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime, timedelta

import numpy as np
from pymodbus.constants import ExcCodes

from stemwatch.connectors.connector import Connector, TagMapping, ValveTags, Window
from stemwatch.connectors.modbus import DevicePoller
from stemwatch.models.recording import Quality, Recording, Role
from stemwatch.service.store.samples.connector import StoredSamples
from stemwatch.service.store.samples.tables import microseconds
from stemwatch.service.store.store import Store
from tests.connectors.modbus.loopback_servers import (
    Behaviour,
    device,
    register,
    serving,
    sim_device,
    tcp,
)

START = datetime(2026, 3, 2, 6, 0, tzinfo=UTC)
EVERY = timedelta(seconds=0.1)
VALVE = ValveTags(
    valve="FIC-1",
    tags={
        Role.OP: TagMapping(tag="OP", unit="%"),
        Role.PV: TagMapping(tag="PV", unit="t/h", low=0.0, high=200.0),
    },
)


async def poll_into(store: Store, behaviour: Behaviour, polls: int) -> None:
    """Poll a served device at so many instants from ``START`` on, and store what it gave."""
    registers = (register("OP", 0, scale=0.1, unit="%"), register("PV", 1, unit="t/h"))
    async with serving(sim_device(1, behaviour)) as served:
        link = tcp(served.port, timeout_s=5.0)
        poller = DevicePoller(device(link, *registers, every_s=0.1), store.samples.write)
        await poller.start()
        for index in range(polls):
            store.samples.write(await poller.poll(microseconds(START + index * EVERY)))
        await poller.stop()


def recording_of(store: Store, window: Window) -> Recording:
    """The valve's recording from the store."""
    source = StoredSamples(store.samples, "plc")
    assert isinstance(source, Connector)
    return source.read(VALVE, window)


def test_polls_become_a_recording(store: Store) -> None:
    """Percent where a range is given, one even clock, UTC, nothing outside the window."""
    asyncio.run(poll_into(store, Behaviour(holding={0: 505, 1: 50}), 12))
    window = Window(start=START, stop=START + 10 * EVERY)
    recording = recording_of(store, window)
    assert recording.interval_s == 0.1
    assert recording.start == START
    assert recording.start.utcoffset() == timedelta(0)
    assert recording.end <= window.stop + EVERY
    assert len(recording) == 10
    assert recording.op.values[recording.op.usable].tolist()[:2] == [50.5, 50.5]
    assert np.nanmax(recording.get(Role.PV).values) == 25.0
    assert recording.get(Role.PV).unit == "%"


def test_what_the_device_did_not_give_is_bad_in_the_recording(store: Store) -> None:
    """A refused register is masked with its reason, the others are there."""
    refusing = Behaviour(holding={0: 505}, refuses={1: ExcCodes.ILLEGAL_ADDRESS})
    asyncio.run(poll_into(store, refusing, 8))
    recording = recording_of(store, Window())
    quality = recording.get(Role.PV).quality
    assert (quality == Quality.BAD).any()
    assert not (quality == Quality.GOOD).any()
    assert recording.op.usable.any()
