"""RTU on a serial line: two pseudo-terminals joined by a wire."""

from __future__ import annotations

import asyncio

from pymodbus import FramerType
from pymodbus.server import ModbusSerialServer

from stemwatch.connectors.modbus.connection import Connection
from stemwatch.connectors.modbus.device import Link, LinkKind
from stemwatch.connectors.modbus.poller import DevicePoller
from stemwatch.connectors.modbus.read_fault import FaultKind, ReadFault
from stemwatch.connectors.modbus.register_address import Table
from stemwatch.connectors.modbus.sample_batch import SampleBatch
from tests.connectors.modbus.loopback_servers import Behaviour, device, register, sim_device


def serial(port: str) -> Link:
    """A link over a serial port that does not wait long."""
    return Link(kind=LinkKind.SERIAL, target=port, timeout_s=0.5)


def test_two_units_on_one_line_are_polled(serial_pair) -> None:
    """Holding registers of one unit and input registers of the other, in one batch."""
    here, there = serial_pair
    first, second = Behaviour(holding={3: 250}), Behaviour(inputs={3: 7})

    async def run() -> list[SampleBatch]:
        devices = [sim_device(1, first), sim_device(2, second)]
        server = ModbusSerialServer(devices, port=there, framer=FramerType.RTU)
        await server.serve_forever(background=True)
        registers = (
            register("ZT", 3, scale=0.1),
            register("B", 3, unit_id=2, table=Table.INPUT),
        )
        batches: list[SampleBatch] = []
        poller = DevicePoller(device(serial(here), *registers, every_s=0.2), batches.append)
        task = asyncio.create_task(poller.run())
        async with asyncio.timeout(20):
            while sum(batch.good == 2 for batch in batches) < 3:
                await asyncio.sleep(0.02)
        task.cancel()
        await asyncio.wait([task])
        await server.shutdown()
        return batches

    batches = asyncio.run(run())
    assert all(batch.values.tolist() == [25.0, 7.0] for batch in batches if batch.good == 2)


def test_a_line_without_a_device_is_silent_not_broken(serial_pair) -> None:
    """The port opens, nobody answers; the port is kept open."""
    here, _ = serial_pair

    async def run() -> tuple[ReadFault, bool]:
        line = Connection(serial(here))
        await line.open()
        try:
            await line.read(1, Table.HOLDING, 0, 2)
        except ReadFault as fault:
            return fault, line.connected
        finally:
            line.close()
        raise AssertionError("an answer from nobody")

    fault, connected = asyncio.run(run())
    assert (fault.kind, connected) == (FaultKind.SILENT, True)
