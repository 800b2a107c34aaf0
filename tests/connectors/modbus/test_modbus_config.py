"""``[[devices]]`` of a plant file: what is understood, and a sentence for each mistake."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import Any

import pytest

from stemwatch.connectors.modbus import DeviceMap, read_devices
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType
from stemwatch.connectors.modbus.device import Link, LinkKind, poll_time_s
from stemwatch.connectors.modbus.device_tables import DeviceTable, keys_of, link_of
from stemwatch.connectors.modbus.register_address import RegisterAddress, Table
from stemwatch.service.config.toml import TomlLines

PLANT = """
[[devices]]
name = "plc-1"
host = "192.168.1.20"
every_s = 0.5
byte_order = "cdab"

[[devices.registers]]
tag = "FIC-101.OP"
register = "holding"
address = 0
type = "float32"
unit = "%"
lowest = -5.0
highest = 105.0

[[devices.registers]]
tag = "FIC-101.ZT"
address = "30004"
type = "UINT16"
raw = [0, 10000]
engineering = [0.0, 100.0]
invalid = [65535, "0x7FFF"]
unit_id = 7

[[devices]]
name = "bus"
type = "serial"
serial_port = "/dev/ttyUSB0"
baudrate = 9600
parity = "e"

[[devices.registers]]
tag = "LIC-200.ZT"
register = "input"
address = 3
type = "UINT16"
scale = 0.1
"""


def read(text: str) -> DeviceMap:
    """The devices of a plant file's text."""
    return read_devices(tomllib.loads(text)["devices"], TomlLines(text).of)


def one_register(**changed: Any) -> DeviceMap:
    """The first device, its registers replaced by one with these keys."""
    table = {"tag": "T", "register": "holding", "address": 0, "type": "UINT16"} | changed
    table = {key: value for key, value in table.items() if value is not None}
    return read_devices([{"name": "plc", "host": "h", "registers": [table]}])


def test_a_map_is_understood() -> None:
    """Two devices, three tables, both ways of scaling, names in any case."""
    recording = read(PLANT)
    assert recording.problems == ()
    plc, bus = recording.devices
    assert (plc.every_s, plc.link.target, plc.link.port) == (0.5, "192.168.1.20", 502)
    op, position = plc.registers
    assert (op.address, op.kind, op.order) == (
        RegisterAddress(Table.HOLDING, 0),
        DataType.FLOAT32,
        ByteOrder.CDAB,
    )
    assert (op.unit_id, op.unit, op.lowest, op.highest) == (1, "%", -5.0, 105.0)
    assert position.address == RegisterAddress(Table.INPUT, 3)
    assert (position.unit_id, position.written) == (7, "30004")
    assert position.read([2500]).value == pytest.approx(25.0)
    assert [bool(position.read([raw]).reason) for raw in (65535, 0x7FFF, 1)] == [True, True, False]
    assert (bus.link.kind, str(bus.link)) == (LinkKind.SERIAL, "/dev/ttyUSB0 (9600 8E1)")


@pytest.mark.parametrize(
    "table",
    [
        {"type": "tcp", "host": "10.1.2.3", "port": 503, "retries": 2},
        {"type": "rtuovertcp", "host": "10.1.2.3", "pause_s": 0.1},
        {"type": "serial", "serial_port": "COM3", "baudrate": 9600, "stopbits": 2},
    ],
)
def test_a_link_gives_back_the_keys_it_was_made_from(table: dict[str, Any]) -> None:
    """With the defaults of its own type beside them, and no key that another type has."""
    link = link_made_from(table)
    keys = keys_of(link)
    assert table.items() <= keys.items()
    assert ("baudrate" in keys) == (table["type"] == "serial")
    assert link_made_from(keys) == link  # which refuses keys of another type


def link_made_from(keys: Mapping[str, Any]) -> Link:
    """The link of a device with these keys."""
    register = {"tag": "T", "register": "holding", "address": 0, "type": "UINT16"}
    return link_of(DeviceTable(name="plc", registers=[register], **keys))


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"address": 40001}, "has two readings"),
        ({"address": 10, "register": None}, "without its table"),
        ({"address": 65535, "type": "UINT32", "byte_order": "ABCD"}, "ends beyond 65535"),
        ({"type": "FLOAT32"}, "stemwatch modbus read shows a register in all four"),
        ({"type": "REAL"}, "expected one of INT16, UINT16"),
        ({"byte_order": "ACBD"}, "expected ABCD, CDAB, BADC or DCBA"),
        ({"register": "coil"}, 'expected "holding" or "input"'),
        ({"scale": 0.0}, "which makes every value the same"),
        ({"raw": [0, 100]}, "found raw without engineering"),
        ({"raw": [5, 5], "engineering": [0, 1]}, "found twice 5"),
        ({"raw": [0, 1], "engineering": [0, 1], "scale": 2.0}, "scale beside raw and engineering"),
        ({"raw": [0, 1, 2], "engineering": [0, 1]}, "two raw numbers"),
        ({"lowest": 5.0, "highest": 5.0}, "lowest below highest"),
        ({"invalid": ["7FFF"]}, '"0x7FFF"'),
        ({"invalid": ["0x7FFFFFFF"]}, "1 words of 4 hexadecimal digits"),
        ({"adress": 3}, "did you mean 'address'?"),
        ({"type": None}, "found nothing; expected one of"),
        ({"tag": ""}, "as text of 1 to 200 letters"),
        ({"unit_id": 256}, "a unit id from 0 to 255"),
        ({"address": True}, "a number counted from 0"),
        ({"scale": float("nan")}, "a number that is not 0"),
    ],
)
def test_a_mistake_in_a_register_is_explained(changed: dict[str, Any], text: str) -> None:
    """Found and expected, with the key; the only register is gone, and so is the device."""
    result = one_register(**changed)
    assert result.devices == ()
    first, last = result.problems
    assert text in str(first)
    name = changed.get("tag") or ("T" if "tag" not in changed else "1")
    assert str(first).startswith(f"plant.toml: devices[plc].registers[{name}].")
    assert "no register that can be read" in str(last)


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"host": None}, 'such as host = "192.168.1.20"'),
        ({"type": "serial", "host": None}, 'such as serial_port = "/dev/ttyUSB0"'),
        ({"type": "serial"}, 'found host beside type = "serial"'),
        ({"baudrate": 9600}, 'found baudrate beside type = "tcp"'),
        ({"type": "udp"}, '"tcp", "rtuovertcp" or "serial"'),
        ({"every_s": 0.05}, "seconds between polls, 0.1 to 10"),
        ({"every_s": 60}, "seconds between polls, 0.1 to 10"),
        ({"max_words": 126}, "4 to 125"),
        ({"name": None}, "a name of its own"),
        ({"registers": []}, "tables, each headed [[devices.registers]]"),
        ({"port": "502"}, "a port from 1 to 65535"),
    ],
)
def test_a_mistake_in_a_device_is_explained(changed: dict[str, Any], text: str) -> None:
    """A device that is wrong is left out with its reason."""
    row = {"tag": "T", "address": "40001", "type": "UINT16"}
    table = {"name": "plc", "host": "h", "registers": [row]} | changed
    table = {key: value for key, value in table.items() if value is not None}
    devices = read_devices([table])
    assert devices.devices == ()
    assert text in str(devices.problems[0])


def test_a_mistake_costs_its_own_register_only_and_names_its_line() -> None:
    """The others are read; the line is that of the key."""
    recording = read(PLANT.replace('address = "30004"', "address = 30004"))
    assert [device.tags for device in recording.devices] == [("FIC-101.OP",), ("LIC-200.ZT",)]
    (problem,) = recording.problems
    assert problem.line == PLANT[: PLANT.index('address = "30004"')].count("\n") + 1
    assert problem.key == "devices[plc-1].registers[FIC-101.ZT].address"


def test_what_is_there_twice_is_said() -> None:
    """Neither a tag of one device nor a device's name may be there twice; the first one counts."""
    row = {"tag": "T", "address": "40001", "type": "UINT16"}
    table = {"name": "plc", "host": "h", "registers": [row, row]}
    devices = read_devices([table, table | {"registers": [row]}])
    assert [device.tags for device in devices.devices] == [("T",)]
    sentences = [str(problem) for problem in devices.problems]
    assert "an earlier register of this device" in sentences[0]
    assert "an earlier device has already" in sentences[1]


def test_a_serial_line_that_cannot_keep_pace_is_refused_with_the_number() -> None:
    """50 registers at 19200 8N1 take about 65 ms, so 0.1 s is enough and 2400 baud is not."""
    rows = [{"tag": f"T{i}", "address": f"{40001 + i}", "type": "UINT16"} for i in range(50)]
    table = {"name": "bus", "type": "serial", "serial_port": "ttyA", "every_s": 0.1}
    quick = read_devices([table | {"registers": rows, "baudrate": 19200}])
    (device,) = quick.devices
    assert 0.059 < poll_time_s(device.blocks(), device.link) < 0.08
    slow = read_devices([table | {"registers": rows, "baudrate": 2400}])
    assert slow.devices == ()
    assert "occupies the line for at least 0.5" in str(slow.problems[0])


def test_nobody_answers_a_broadcast_on_rtu() -> None:
    """Unit 0 is common on TCP and never answered on a serial line."""
    row = {"tag": "T", "address": "40001", "type": "UINT16", "unit_id": 0}
    assert len(read_devices([{"name": "a", "host": "h", "registers": [row]}]).devices) == 1
    devices = read_devices([{"name": "a", "type": "rtuovertcp", "host": "h", "registers": [row]}])
    assert "broadcast" in str(devices.problems[0])
