"""Nothing is ever written to a plant: not called, not sent, not received."""

from __future__ import annotations

import ast
import asyncio
import inspect
from pathlib import Path

import pytest
from pymodbus import FramerType
from pymodbus.client.mixin import ModbusClientMixin

from stemwatch.connectors.modbus.commissioning import try_map
from stemwatch.connectors.modbus.connection import Connection, OnlyReading, only_reading
from stemwatch.connectors.modbus.device import LinkKind
from stemwatch.connectors.modbus.poller import DevicePoller
from stemwatch.connectors.modbus.read_fault import ReadFault
from stemwatch.connectors.modbus.register_address import Table
from tests.connectors.modbus.loopback_servers import (
    Behaviour,
    device,
    register,
    serving,
    sim_device,
    tcp,
)

PACKAGE = Path(inspect.getfile(Connection)).parent
REPOSITORY = Path(__file__).parents[3]
ALLOWED = {"read_holding_registers", "read_input_registers"}
# Every request that pymodbus's clients can make; among them all that write.
REQUESTS = {
    name
    for name, member in inspect.getmembers(ModbusClientMixin, inspect.isfunction)
    if "no_response_expected" in inspect.signature(member).parameters
} - {"execute"}  # sends what it is given, by any name


def test_the_list_of_requests_holds_those_that_write() -> None:
    """The check below would see nothing if the list were empty or the library had moved on."""
    writing = {"write_register", "write_registers", "write_coil", "write_coils"}
    assert writing | {"mask_write_register", "readwrite_registers"} | ALLOWED <= REQUESTS


@pytest.mark.parametrize("folder", ["connectors", "service", "models"])
def test_no_code_names_a_request_that_is_not_a_read(folder: str) -> None:
    """No attribute, name or text in the packages is a request of pymodbus but the two reads."""
    result, forbidden = [], REQUESTS - ALLOWED
    for path in sorted((REPOSITORY / folder).rglob("*.py")):
        text = path.read_text("utf-8")
        if not any(name in text for name in forbidden):
            continue
        for node in ast.walk(ast.parse(text)):
            names = {
                getattr(node, "attr", None),
                getattr(node, "id", None),
                node.value if isinstance(node, ast.Constant) else None,
            }
            names = {name for name in names if isinstance(name, str)}
            result += [f"{path.name}: {name}" for name in names & forbidden]
    assert result == []


def test_only_one_file_of_the_connector_knows_the_library() -> None:
    """Code that can send anything is in connection.py, which checks every frame."""
    knowing = {
        path.name
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
        if name.split(".")[0] in ("pymodbus", "serial")
    }
    assert knowing == {"connection.py"}


@pytest.mark.parametrize("rtu", [False, True])
@pytest.mark.parametrize("function", range(256))
def test_only_functions_3_and_4_pass_the_frame_check(function: int, rtu: bool) -> None:
    """Of all 256, as a TCP frame and as an RTU frame."""
    frame = bytes([1, function]) if rtu else bytes([0, 1, 0, 0, 0, 6, 1, function])
    if function in (3, 4):
        assert only_reading(frame, rtu=rtu) == frame
        return
    with pytest.raises(OnlyReading, match="was not sent"):
        only_reading(frame, rtu=rtu)


@pytest.mark.parametrize("framer", [FramerType.SOCKET, FramerType.RTU])
def test_a_write_forced_on_the_client_never_leaves(framer: FramerType) -> None:
    """Even with direct access to the library's client nothing can be written: every request of the
    library but the reads fails the frame check, and the server receives nothing."""
    requests = {
        "write_register": {"address": 0, "value": 1},
        "write_registers": {"address": 0, "values": [1]},
        "write_coil": {"address": 0, "value": True},
        "write_coils": {"address": 0, "values": [True]},
        "mask_write_register": {},
        "readwrite_registers": {"read_count": 1, "values": [1]},
        "read_coils": {"address": 0},
        "read_discrete_inputs": {"address": 0},
    }

    async def run() -> list[int]:
        kind = LinkKind.TCP if framer is FramerType.SOCKET else LinkKind.RTU_OVER_TCP
        async with serving(sim_device(1, Behaviour()), framer=framer) as served:
            line = Connection(tcp(served.port, kind=kind))
            await line.open()
            for name, arguments in requests.items():
                with pytest.raises(OnlyReading):
                    await getattr(line._client, name)(**arguments)
            await line.read(1, Table.HOLDING, 0, 1)
            line.close()
            return served.functions

    assert asyncio.run(run()) == [3]


def test_a_server_that_records_sees_functions_3_and_4_only() -> None:
    """Polling, trying a map, refusals, splits, silence, reconnects: nothing else ever arrives."""

    async def run() -> set[int]:
        from pymodbus.constants import ExcCodes

        behaviour = Behaviour(refuses={20: ExcCodes.ILLEGAL_ADDRESS})
        async with serving(sim_device(1, behaviour)) as served:
            registers = [register(f"H{i}", i) for i in range(40)]
            registers += [register(f"I{i}", i, table=Table.INPUT) for i in range(40)]
            plc = device(tcp(served.port, timeout_s=0.5), *registers, every_s=0.1)
            await try_map(plc)
            polling = asyncio.create_task(DevicePoller(plc, lambda batch: None).run())
            await asyncio.sleep(0.5)
            behaviour.delay_s = 0.8
            await asyncio.sleep(1.0)
            behaviour.delay_s = 0.0
            served.cut()
            await asyncio.sleep(0.8)
            polling.cancel()
            await asyncio.wait([polling])
            return set(served.functions)

    assert asyncio.run(run()) == {3, 4}


def test_reading_a_closed_connection_is_a_fault() -> None:
    """Reading before the connection is opened raises a ``ReadFault``."""
    with pytest.raises(ReadFault, match="no connection"):
        asyncio.run(Connection(tcp(1)).read(1, Table.HOLDING, 0, 1))
