"""Real Modbus servers on loopback, each of which records what it was asked."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, cast

from pymodbus import FramerType
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from stemwatch.connectors.modbus.datatypes import ByteOrder
from stemwatch.connectors.modbus.datatypes import DataType as Kind
from stemwatch.connectors.modbus.device import Device, Link, LinkKind
from stemwatch.connectors.modbus.register import Register
from stemwatch.connectors.modbus.register_address import RegisterAddress, Table


@dataclass
class Behaviour:
    """What a served device holds, and how it misbehaves; changed while it runs."""

    holding: dict[int, int] = field(default_factory=dict)
    inputs: dict[int, int] = field(default_factory=dict)
    refuses: dict[int, ExcCodes] = field(default_factory=dict)  # by address
    exception: ExcCodes | None = None  # for every request
    delay_s: float = 0.0
    asked: list[tuple[int, int, int]] = field(default_factory=list)  # function, address, count

    async def answer(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        set_values: list[int] | None,
    ) -> ExcCodes | None:
        """The simulator's hook: called for each request before it is answered."""
        self.asked.append((function, address, count))
        if self.delay_s:
            await asyncio.sleep(self.delay_s)
        if self.exception is not None:
            return self.exception
        memory = self.holding if function == 3 else self.inputs
        for index in range(address, address + count):
            if index in self.refuses:
                return self.refuses[index]
            registers[index - start] = memory.get(index, 0)
        return None


@dataclass
class Served:
    """A server that runs: its port, the function codes that arrived, and a way to stop it."""

    port: int
    server: Any
    functions: list[int]

    async def stop(self) -> None:
        """Cut every connection and stop listening."""
        await self.server.shutdown()

    def cut(self) -> None:
        """Cut every connection and go on listening."""
        for handler in list(self.server.active_connections.values()):
            handler.transport.abort()


@asynccontextmanager
async def answering(reply: Callable[[bytes], bytes | None]) -> AsyncIterator[int]:
    """A server that answers each request with the bytes that ``reply`` makes of it, and hangs up
    at ``None``. Yields its port."""

    open_transports: list[asyncio.Transport] = []

    class Talk(asyncio.Protocol):
        """One connection."""

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            self.transport = cast(asyncio.Transport, transport)
            open_transports.append(self.transport)

        def data_received(self, data: bytes) -> None:
            if (answer := reply(data)) is None:
                self.transport.close()
            else:
                self.transport.write(answer)

    server = await asyncio.get_running_loop().create_server(Talk, "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        server.close()
        for transport in open_transports:
            transport.abort()
        await asyncio.sleep(0)


def sim_device(unit_id: int, behaviour: Behaviour, size: int = 400) -> SimDevice:
    """A device with ``size`` holding and input registers that ``behaviour`` fills."""

    def block() -> list[SimData]:
        return [SimData(0, values=[0] * size, datatype=DataType.REGISTERS)]

    bits = [SimData(0, values=[False] * 16, datatype=DataType.BITS)]
    return SimDevice(
        id=unit_id, simdata=(bits, list(bits), block(), block()), action=behaviour.answer
    )


@asynccontextmanager
async def serving(
    *devices: SimDevice, port: int = 0, framer: FramerType = FramerType.SOCKET
) -> AsyncIterator[Served]:
    """Serve ``devices`` on loopback."""
    functions: list[int] = []

    def note(sending: bool, data: bytes) -> bytes:
        if not sending:
            functions.append(data[7 if framer is FramerType.SOCKET else 1])
        return data

    server: Any = ModbusTcpServer(
        list(devices), address=("127.0.0.1", port), framer=framer, trace_packet=note
    )
    await server.serve_forever(background=True)
    bound = server.transport.sockets[0].getsockname()[1]
    try:
        yield Served(bound, server, functions)
    finally:
        await server.shutdown()


def tcp(port: int, **more: Any) -> Link:
    """A link to loopback that does not wait long."""
    settings = {"kind": LinkKind.TCP, "timeout_s": 0.3} | more
    return Link(target="127.0.0.1", port=port, **settings)


def register(
    tag: str,
    first: int,
    kind: Kind = Kind.UINT16,
    *,
    table: Table = Table.HOLDING,
    unit_id: int = 1,
    **more: Any,
) -> Register:
    """A register of a map."""
    order = more.pop("order", ByteOrder.ABCD)
    return Register(
        tag=tag,
        unit_id=unit_id,
        address=RegisterAddress(table, first),
        kind=kind,
        order=order,
        **more,
    )


def device(link: Link, *registers: Register, **more: Any) -> Device:
    """A device with a map."""
    return Device(name="plc", link=link, registers=registers, **more)
