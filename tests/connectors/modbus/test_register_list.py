"""Register lists: a spreadsheet's rows as registers, with file and line of each mistake."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from stemwatch.connectors.modbus import DeviceMap, read_devices
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType
from stemwatch.connectors.modbus.register_address import RegisterAddress, Table
from stemwatch.connectors.modbus.register_list import COLUMNS, ListUnusable, read_register_list
from stemwatch.service.config.toml import TomlLines

PLANT = """
[[devices]]
name = "plc-1"
host = "192.168.1.20"
registers = "registers.csv"
"""
# What may stand in a row that is passed over as empty: spaces of any kind, commas and quotes.
BLANK = '," \t\n\x0b\x0c\r\x85\u00a0\u1680\u2028\u2029\u202f\u205f\u3000' + "".join(
    map(chr, range(0x2000, 0x200B))
)
HEADING = ",".join(name for name in COLUMNS if name not in ("scale", "offset"))
GOOD = (
    HEADING
    + """
FIC-101.OP,holding,0,,float32,cdab,,,,,,-5,105,%,Feed
FIC-101.ZT,,30004,7,UINT16,,0,10000,0,100,65535|0x7FFF,,,%,"Position, valve"
LIC-1.PV,input,0x000B,,INT16,,,,,,,,,,
"""
)


def read(folder: Path, text: str | bytes, plant: str = PLANT) -> DeviceMap:
    """The devices of a plant file whose list has this text."""
    content = text if isinstance(text, bytes) else text.encode()
    (folder / "registers.csv").write_bytes(content)
    return read_devices(tomllib.loads(plant)["devices"], TomlLines(plant).of, folder=folder)


def test_rows_are_registers(tmp_path: Path) -> None:
    """Every way of writing that the tables know, in columns."""
    recording = read(tmp_path, GOOD)
    assert recording.problems == ()
    op, zt, pv = recording.devices[0].registers
    assert (op.tag, op.kind, op.order) == ("FIC-101.OP", DataType.FLOAT32, ByteOrder.CDAB)
    assert op.address == RegisterAddress(Table.HOLDING, 0)
    assert (op.lowest, op.highest, op.unit, op.description) == (-5.0, 105.0, "%", "Feed")
    assert zt.address == RegisterAddress(Table.INPUT, 3)
    assert (zt.unit_id, zt.scale, zt.invalid) == (7, 0.01, frozenset({65535}))
    assert zt.invalid_words == frozenset({(0x7FFF,)})
    assert zt.description == "Position, valve"
    assert pv.address == RegisterAddress(Table.INPUT, 11)


def test_a_list_is_what_the_tables_are(tmp_path: Path) -> None:
    """The same map in both forms gives the same registers."""
    tables = """
[[devices]]
name = "plc-1"
host = "192.168.1.20"
[[devices.registers]]
tag = "A"
register = "holding"
address = 12
type = "INT32"
byte_order = "ABCD"
scale = 0.1
offset = -4.0
invalid = [-1, "0x7FFF FFFF"]
"""
    listing = (
        "tag,register,address,type,byte_order,scale,offset,invalid\n"
        "A,holding,12,INT32,ABCD,0.1,-4,-1|0x7FFF FFFF\n"
    )
    assert read(tmp_path, listing).devices == read(tmp_path, "", tables).devices


def test_names_and_marks_of_others_are_understood(tmp_path: Path) -> None:
    """Headings of other tools, a spreadsheet's semicolons, decimal commas and byte order mark."""
    text = "Name;Slave ID;Address;Data Type;Scale;Min Value;Units;\nA;3;40001;int16;0,1;-5,5;%;\n"
    for content in (
        text.encode("utf-8-sig"),
        text.encode("utf-16"),
        text.replace("\n", "\r\n").encode(),
    ):
        recording = read(tmp_path, content)
        assert recording.problems == ()
        (register,) = recording.devices[0].registers
        assert (register.tag, register.unit_id, register.scale) == ("A", 3, 0.1)
        assert (register.lowest, register.unit) == (-5.5, "%")


@pytest.mark.parametrize(
    ("row", "answer"),
    [
        ("B,holding,5,INT99,,,", "registers[B].type: found the text 'INT99'"),
        ("B,holding,5,INT32,,,", "registers[B].byte_order: found nothing"),
        ("B,holding,40001,INT16,,,", "two readings"),
        ("B,,70001,INT16,,,", "registers[B].address"),
        ("B,holding,,INT16,,,", "registers[B].address"),
        (",holding,5,INT16,,,", "registers[2].tag: found nothing"),
        ("A,holding,5,INT16,,,", "an earlier register of this device has already"),
        ("B,holding,5,INT16,,ten,", "registers[B].scale: found the text 'ten'"),
        ("B,holding,5,INT16,,0,", "registers[B].scale: found 0"),
        ("B,holding,5,INT16,,nan,", "registers[B].scale"),
        ("B,holding,5,INT16,,,0x7F", "registers[B].invalid"),
        ("B,holding,5", "row: found 3 cells; expected 7"),
        ("B,holding,5,INT16,,,,more", "row: found 8 cells; expected 7"),
    ],
)
def test_a_bad_row_is_said_with_its_line_and_the_rest_goes_on(
    tmp_path: Path, row: str, answer: str
) -> None:
    """File, line, what was found and expected; the rows around it are polled."""
    text = (
        "tag,register,address,type,byte_order,scale,invalid\n"
        f'A,holding,0,INT16,,,"1|2"\n\n{row}\nC,holding,9,INT16,,,\n'
    )
    recording = read(tmp_path, text)
    assert [register.tag for register in recording.devices[0].registers] == ["A", "C"]
    (problem,) = recording.problems
    assert str(problem).startswith("registers.csv, line 4: ")
    assert answer in str(problem)


def test_half_a_range_names_the_column_that_is_missing(tmp_path: Path) -> None:
    """A range has four columns; one alone is no range."""
    text = "tag,register,address,type,raw_low,raw_high\nA,holding,0,INT16,0,\nB,holding,1,INT16,,\n"
    recording = read(tmp_path, text)
    (problem,) = recording.problems
    assert "line 2: row: found raw_high: raw_low without raw_high" in str(problem)
    assert len(recording.devices[0].registers) == 1


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("", "line 1: row: found an empty file"),
        ("tag,address,typ\n", "line 1: column typ: found an unknown column"),
        ("tag,address,typ\n", "did you mean 'type'?"),
        ("tag,address\nA,40001\n", "column type: found nothing"),
        ("tag,name,address,type\n", "column tag: found 2 columns"),
        ("tag,address,type\n", "no row in 'registers.csv'"),
        ('tag,address,type\n"A,40001,INT16\n', "line 2: row: found a row that is not CSV"),
        (b"tag,address,type\nV\xe4,40001,INT16\n", "line 2: row: found the byte 0xe4"),
        (b"\xef\xbb\xbftag,address,type\nV\xe4,4,INT16\n", "line 2: row: found the byte 0xe4"),
    ],
)
def test_what_spoils_the_whole_list_leaves_its_device_out(
    tmp_path: Path, text: str | bytes, answer: str
) -> None:
    """A misread heading would be wrong for every register; other devices run."""
    other = '\n[[devices]]\nname = "b"\nhost = "h"\n[[devices.registers]]\n'
    other += 'tag = "X"\naddress = "40001"\ntype = "INT16"\n'
    recording = read(tmp_path, text, PLANT + other)
    assert [device.name for device in recording.devices] == ["b"]
    assert answer in "\n".join(str(problem) for problem in recording.problems)


def test_a_list_that_is_not_there_is_said_where_it_is_named(tmp_path: Path) -> None:
    """The line is that of the plant file."""
    plant = PLANT.replace("registers.csv", "gone.csv")
    devices = read_devices(tomllib.loads(plant)["devices"], TomlLines(plant).of, folder=tmp_path)
    assert devices.devices == ()
    (problem,) = devices.problems
    assert str(problem).startswith("plant.toml, line 5: devices[plc-1].registers: found 'gone.csv'")
    assert "No such file" in str(problem)


@given(st.binary(max_size=300))
@example(b"\x1c")  # blank to str.strip, not to bytes.strip: a damaged row, and said to be one
@example(b"\x1c,\x1d,\x1e\x1f")
@example("\u00a0,\u2003,\n".encode())  # blank, as spreadsheets write it
@example(b'"",\n')
def test_whatever_the_bytes_are_something_is_said_or_read(tmp_path_factory, content: bytes) -> None:
    """No file ends the program."""
    path = tmp_path_factory.mktemp("list") / "registers.csv"
    path.write_bytes(b"tag,address,type\n" + content)
    text, keys = "", set[str]()
    try:
        register_list = read_register_list(path)
        keys = {key for row in register_list.rows for key in row.table}
    except ListUnusable as mistake:
        text = mistake.expected
    assert keys <= {"tag", "address", "type"}
    seen = "".join(set(content.decode(errors="replace")) - set(BLANK))
    assert text or not seen or register_list.rows or register_list.faulty


def test_a_row_of_control_codes_is_said_to_be_damaged(tmp_path: Path) -> None:
    """It is not passed over as an empty row: something was there."""
    recording = read(tmp_path, GOOD.encode() + b"\x1c\n")
    assert len(recording.devices[0].registers) == 3
    (problem,) = recording.problems
    assert str(problem).startswith("registers.csv, line 5: row: found 1 cells; expected ")


def test_the_plant_file_and_the_command_read_the_list(tmp_path: Path) -> None:
    """Relative to the plant file, and its mistakes are the plant's problems."""
    from stemwatch.service.cli.modbus import _devices
    from stemwatch.service.config import load_plant

    (tmp_path / "registers.csv").write_text(GOOD + "X,holding,1,INT99\n", encoding="utf-8")
    valve = '[[valves]]\nid = "FIC-101"\nsource = "plc-1"\n[valves.tags.op]\ntag = "FIC-101.OP"\n'
    (tmp_path / "plant.toml").write_text(PLANT + valve, encoding="utf-8")
    plant = load_plant(tmp_path / "plant.toml", environment={})
    assert len(plant.devices["plc-1"].registers) == 3
    assert plant.is_live("FIC-101")
    assert [str(problem).split(":")[0] for problem in plant.problems] == ["registers.csv, line 5"]
    (device,) = _devices(tmp_path / "plant.toml", "plc-1")
    assert device == plant.devices["plc-1"]
