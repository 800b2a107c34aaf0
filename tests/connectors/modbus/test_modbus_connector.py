"""A device as a source of recordings: live, and honest about having no history."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from stemwatch.connectors.connector import (
    WHOLE,
    Connector,
    ConnectorError,
    TagMapping,
    UnknownTag,
    ValveTags,
    Window,
)
from stemwatch.connectors.modbus import ModbusConnector
from stemwatch.connectors.modbus.device import Device
from stemwatch.models.recording import Quality, Role
from tests.connectors.modbus.served import Behaviour, device, register, serving, sim_device, tcp

VALVE = ValveTags(
    valve="FIC-1",
    tags={
        Role.OP: TagMapping(tag="OP", unit="%"),
        Role.PV: TagMapping(tag="PV", unit="t/h", low=0.0, high=200.0),
    },
)


@contextmanager
def served(behaviour: Behaviour) -> Iterator[Device]:
    """A device that is served by another thread."""
    ready, stop = threading.Event(), threading.Event()
    ports: list[int] = []

    async def serve() -> None:
        async with serving(sim_device(1, behaviour)) as one:
            ports.append(one.port)
            ready.set()
            await asyncio.to_thread(stop.wait)

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    assert ready.wait(20)
    registers = (register("OP", 0, scale=0.1, unit="%"), register("PV", 1, unit="t/h"))
    try:
        yield device(tcp(ports[0]), *registers, every_s=0.1)
    finally:
        stop.set()
        thread.join()


def ahead(seconds: float) -> Window:
    """A window from now."""
    return Window(stop=datetime.now(UTC) + timedelta(seconds=seconds))


def test_a_window_ahead_is_recorded() -> None:
    """Percent where a range is given, one even clock, UTC, nothing outside the window."""
    with served(Behaviour(holding={0: 505, 1: 50})) as plc:
        source = ModbusConnector(plc)
        assert isinstance(source, Connector)
        window = ahead(1.2)
        recording = source.read(VALVE, window)
    assert recording.interval_s == 0.1
    assert recording.start is not None
    assert recording.start.utcoffset() == timedelta(0)
    assert window.stop is not None
    assert recording.end <= window.stop + timedelta(seconds=0.1)
    assert len(recording) >= 5
    assert recording.op.values[recording.op.usable].tolist()[:2] == [50.5, 50.5]
    assert np.nanmax(recording.get(Role.PV).values) == 25.0
    assert recording.get(Role.PV).unit == "%"


def test_what_the_device_did_not_give_is_bad_in_the_recording() -> None:
    """A refused register is masked with its reason, the others are there."""
    from pymodbus.constants import ExcCodes

    with served(Behaviour(holding={0: 505}, refuses={1: ExcCodes.ILLEGAL_ADDRESS})) as plc:
        recording = ModbusConnector(plc).read(VALVE, ahead(0.8))
    quality = recording.get(Role.PV).quality
    assert (quality == Quality.BAD).any()
    assert not (quality == Quality.GOOD).any()
    assert recording.op.usable.any()


@pytest.mark.parametrize(
    "window",
    [
        WHOLE,
        Window(stop=datetime(2020, 1, 1, tzinfo=UTC)),
        Window(
            start=datetime.now(UTC) - timedelta(hours=1),
            stop=datetime.now(UTC) + timedelta(hours=1),
        ),
    ],
)
def test_history_is_refused_with_what_to_do(window: Window) -> None:
    """A register holds the present value; nothing is made up, and nothing is waited for."""
    with pytest.raises(ConnectorError, match="Modbus has no history") as caught:
        ModbusConnector(device(tcp(1), register("OP", 0), register("PV", 1))).read(VALVE, window)
    assert "Collect first" in str(caught.value)


def test_nobody_waits_for_days() -> None:
    """A window longer than four hours is a matter for collecting."""
    with pytest.raises(ConnectorError, match="Collect into the store"):
        ModbusConnector(device(tcp(1), register("OP", 0), register("PV", 1))).read(
            VALVE, ahead(86_400)
        )


def test_the_tags_are_those_of_the_map() -> None:
    """Each with the two forms of its address, and no role guessed; an unknown one is refused."""
    source = ModbusConnector(device(tcp(1), register("OP", 0, unit="%")))
    (info,) = source.tags()
    assert (info.tag, info.unit, info.proposed_role) == ("OP", "%", None)
    assert info.remark == "unit 1, holding 0 (40001)"
    with pytest.raises(UnknownTag, match="no tag 'PV'; it has OP"):
        source.read(VALVE, ahead(1))
