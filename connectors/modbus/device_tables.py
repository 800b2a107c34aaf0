"""The tables ``[[devices]]`` and ``[[devices.registers]]`` of a plant file.

Each field's description is what an error says was expected.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from stemwatch.connectors.modbus.blocks import MAX_WORDS
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType
from stemwatch.connectors.modbus.device import DEFAULT_PORT, FASTEST_S, SLOWEST_S, Link, LinkKind
from stemwatch.connectors.modbus.register import Register
from stemwatch.connectors.modbus.register_address import LAST_ADDRESS, Table, parse_address
from stemwatch.connectors.settings import TomlTable


class TableMistake(Exception):
    """What is wrong at ``key`` of a table, as the two halves of a sentence."""

    def __init__(self, key: str, found: str, expected: str) -> None:
        self.key, self.found, self.expected = key, found, expected
        super().__init__(f"{key}: found {found}; expected {expected}")


def _upper(value: Any) -> Any:
    return value.strip().upper() if isinstance(value, str) else value


def _member(kind: type[StrEnum], in_file: Callable[[str], str]) -> BeforeValidator:
    """A text in any case as the member of ``kind``; strict tables take nothing but members."""

    def convert(value: Any) -> Any:
        return kind(in_file(value.strip())) if isinstance(value, str) else value

    return BeforeValidator(convert)


Name = Annotated[str, Field(min_length=1, max_length=200)]
UnitId = Annotated[int, Field(ge=0, le=255)]
Kind = Annotated[DataType, _member(DataType, str.upper)]
Order = Annotated[ByteOrder, _member(ByteOrder, str.upper)]
Memory = Annotated[Table, _member(Table, str.lower)]
Carrier = Annotated[LinkKind, _member(LinkKind, str.lower)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]

_ORDERS = "ABCD, CDAB, BADC or DCBA"


class RegisterTable(TomlTable):
    """``[[devices.registers]]``: one tag of a device."""

    tag: Name = Field(description="the tag's name, as text of 1 to 200 letters")
    # The attribute cannot be called register: every class has a method of that name.
    memory: Memory | None = Field(
        default=None, alias="register", description='"holding" or "input"'
    )
    address: int | str = Field(
        description="a number counted from 0 beside register, or one text counted from 1 such as "
        '"40001"'
    )
    unit_id: UnitId | None = Field(default=None, description="a unit id from 0 to 255")
    type: Kind = Field(description="one of " + ", ".join(DataType))
    byte_order: Order | None = Field(default=None, description=_ORDERS)
    scale: float | None = Field(default=None, description="a number that is not 0")
    offset: float | None = Field(default=None, description="a number")
    raw: Pair | None = Field(default=None, description="two raw numbers, such as [0, 10000]")
    engineering: Pair | None = Field(
        default=None, description="the two values that raw stands for, such as [0.0, 100.0]"
    )
    invalid: list[int | float | str] = Field(
        default=[],
        description='a list of raw numbers, or of words as texts such as "0x7FFF" or "0x7FC0 0000"',
    )
    lowest: float | None = Field(default=None, description="a number in engineering units")
    highest: float | None = Field(default=None, description="a number in engineering units")
    unit: str = Field(default="", description='a unit such as "%" or "t/h"')
    description: str = Field(default="", description="text on one line")


class DeviceTable(TomlTable):
    """``[[devices]]``: one connection and its polling; the registers are looked into one by one."""

    name: Name = Field(description="a name of its own for the device, as text of 1 to 200 letters")
    type: Carrier = Field(default=LinkKind.TCP, description='"tcp", "rtuovertcp" or "serial"')
    host: Name | None = Field(default=None, description="a host name or address")
    port: Annotated[int, Field(ge=1, le=65535)] | None = Field(
        default=None, description=f"a port from 1 to 65535; {DEFAULT_PORT} where left out"
    )
    serial_port: Name | None = Field(
        default=None, description='a serial port such as "/dev/ttyUSB0" or "COM3"'
    )
    baudrate: Annotated[int, Field(ge=300, le=4_000_000)] | None = Field(
        default=None, description="bits per second, such as 9600 or 19200"
    )
    bytesize: Literal[7, 8] | None = Field(default=None, description="7 or 8")
    parity: Annotated[Literal["N", "E", "O"], BeforeValidator(_upper)] | None = Field(
        default=None, description='"N", "E" or "O"'
    )
    stopbits: Literal[1, 2] | None = Field(default=None, description="1 or 2")
    unit_id: UnitId = Field(default=1, description="a unit id from 0 to 255")
    every_s: Annotated[float, Field(ge=FASTEST_S, le=SLOWEST_S)] = Field(
        default=1.0, description=f"seconds between polls, {FASTEST_S:g} to {SLOWEST_S:g}"
    )
    timeout_s: Annotated[float, Field(ge=0.02, le=60.0)] = Field(
        default=1.0, description="seconds that an answer is waited for, 0.02 to 60"
    )
    retries: Annotated[int, Field(ge=0, le=10)] = Field(
        default=0, description="how often one request is repeated, 0 to 10"
    )
    pause_s: Annotated[float, Field(ge=0.0, le=5.0)] = Field(
        default=0.0, description="seconds of rest between two requests, 0 to 5"
    )
    latest_answer_s: Annotated[float, Field(ge=0.0, le=600.0)] = Field(
        default=0.0,
        description="seconds after a request in which its answer may still come, 0 to 600; 0 is "
        "ten seconds, or five times timeout_s where that is longer",
    )
    max_words: Annotated[int, Field(ge=4, le=MAX_WORDS)] = Field(
        default=MAX_WORDS, description=f"the most registers in one request, 4 to {MAX_WORDS}"
    )
    max_gap: Annotated[int, Field(ge=0, le=MAX_WORDS)] = Field(
        default=8, description="the most unused registers that one request bridges, 0 to 125"
    )
    byte_order: Order | None = Field(default=None, description=_ORDERS)
    registers: list[dict[str, Any]] = Field(
        description="tables, each headed [[devices.registers]], or the name of a CSV file such as "
        '"registers.csv"',
        min_length=1,
    )


_OF_TCP = ("host", "port")
_OF_SERIAL = ("serial_port", "baudrate", "bytesize", "parity", "stopbits")
_OF_BOTH = ("timeout_s", "retries", "pause_s", "latest_answer_s")


def link_of(table: DeviceTable) -> Link:
    """The link that ``table`` describes. Raises ``TableMistake`` where keys of a serial port stand
    beside TCP or the other way round, or where the host or the port is not named."""
    serial = table.type is LinkKind.SERIAL
    foreign = _OF_TCP if serial else _OF_SERIAL
    for key in foreign:
        if getattr(table, key) is not None:
            contradiction = f'{key} beside type = "{table.type.value}"'
            keys = ", ".join(_OF_SERIAL if serial else _OF_TCP)
            raise TableMistake(key, contradiction, f"{keys}, or another type")
    target = table.serial_port if serial else table.host
    if target is None:
        key, example = ("serial_port", "/dev/ttyUSB0") if serial else ("host", "192.168.1.20")
        raise TableMistake(key, "nothing", f'where the device is, such as {key} = "{example}"')
    return Link(
        kind=table.type,
        target=target,
        port=table.port or DEFAULT_PORT,
        baudrate=table.baudrate or 19200,
        bytesize=table.bytesize or 8,
        parity=table.parity or "N",
        stopbits=table.stopbits or 1,
        timeout_s=table.timeout_s,
        retries=table.retries,
        pause_s=table.pause_s,
        latest_answer_s=table.latest_answer_s,
    )


def keys_of(link: Link) -> dict[str, str | int | float]:
    """What ``link_of`` makes ``link`` from: the plant file's keys with their values, defaults
    included, and none that another type of link has."""
    keys: dict[str, str | int | float] = {"type": link.kind.value}
    if link.kind is LinkKind.SERIAL:
        keys["serial_port"] = link.target
        keys |= {key: getattr(link, key) for key in _OF_SERIAL[1:]}
    else:
        keys |= {"host": link.target, "port": link.port}
    return keys | {key: getattr(link, key) for key in _OF_BOTH}


_HEX_WORDS = re.compile(r"0x([0-9a-fA-F]{4}(?:[ _]?[0-9a-fA-F]{4})*)")


def register_of(table: RegisterTable, device: DeviceTable) -> Register:
    """The register that ``table`` describes, with what ``device`` says for all of its own.

    Raises ``TableMistake`` for values that contradict one another and ``AddressError`` for an
    address that cannot be understood or has two readings.
    """
    address = parse_address(table.address, table.memory)
    if address.offset + table.type.words - 1 > LAST_ADDRESS:
        address_found = (
            f"{table.address!r}, so that a {table.type.value} ends beyond {LAST_ADDRESS}"
        )
        raise TableMistake(
            "address", address_found, f"an address up to {LAST_ADDRESS + 1 - table.type.words}"
        )
    unit_id = device.unit_id if table.unit_id is None else table.unit_id
    if unit_id == 0 and device.type is not LinkKind.TCP:
        key = "unit_id" if table.unit_id is not None else "tag"
        raise TableMistake(key, "unit id 0, the broadcast that no unit answers on RTU", "1 to 255")
    scale, offset = _scaling(table)
    numbers, words = _invalid(table)
    _check_limits(table)
    return Register(
        tag=table.tag,
        unit_id=unit_id,
        address=address,
        kind=table.type,
        order=_order(table, device),
        scale=scale,
        offset=offset,
        invalid=numbers,
        invalid_words=words,
        lowest=table.lowest,
        highest=table.highest,
        unit=table.unit,
        description=table.description,
        written=str(table.address),
    )


def _order(table: RegisterTable, device: DeviceTable) -> ByteOrder:
    order = table.byte_order or device.byte_order
    if order is None and table.type.words > 1:
        expected = "ABCD, CDAB, BADC or DCBA here or at the device: vendors differ, and none is "
        expected += "safe to assume (stemwatch modbus read shows a register in all four)"
        raise TableMistake(
            "byte_order", f"nothing, for a {table.type.value} of several words", expected
        )
    return order or ByteOrder.ABCD


def _scaling(table: RegisterTable) -> tuple[float, float]:
    """``(scale, offset)`` of ``raw * scale + offset``."""
    if (table.raw is None) != (table.engineering is None):
        given_end, other = ("raw", "engineering") if table.raw else ("engineering", "raw")
        raise TableMistake(given_end, f"{given_end} without {other}", "both, or neither")
    if table.raw is None or table.engineering is None:
        scale = 1.0 if table.scale is None else table.scale
        if scale == 0.0:
            raise TableMistake(
                "scale", "0, which makes every value the same", "a number that is not 0"
            )
        return scale, table.offset or 0.0
    for key in ("scale", "offset"):
        if getattr(table, key) is not None:
            raise TableMistake(key, f"{key} beside raw and engineering", "one way of scaling")
    (raw_low, raw_high), (low, high) = table.raw, table.engineering
    if raw_low == raw_high or low == high:
        key = "raw" if raw_low == raw_high else "engineering"
        raise TableMistake(key, f"twice {getattr(table, key)[0]:g}", "two different numbers")
    scale = (high - low) / (raw_high - raw_low)
    return scale, low - raw_low * scale


def _invalid(table: RegisterTable) -> tuple[frozenset[float], frozenset[tuple[int, ...]]]:
    """Raw numbers, and words as they stand in the registers."""
    numbers: set[float] = set()
    words: set[tuple[int, ...]] = set()
    for entry in table.invalid:
        if isinstance(entry, int | float):
            numbers.add(entry)
        elif entry.strip().lower() != "nan":  # never valid in any case
            words.add(_words(entry, table.type))
    return frozenset(numbers), frozenset(words)


def _words(text: str, kind: DataType) -> tuple[int, ...]:
    match = _HEX_WORDS.fullmatch(text.strip())
    digits = re.sub("[ _]", "", match[1]) if match else ""
    if len(digits) != 4 * kind.words:
        expected = f"{kind.words} words of 4 hexadecimal digits as they stand in the registers, "
        expected += f'such as "0x{" ".join(["7FFF", "FFFF", "FFFF", "FFFF"][: kind.words])}"'
        raise TableMistake("invalid", f"{text!r}", expected)
    return tuple(int(digits[i : i + 4], 16) for i in range(0, len(digits), 4))


def _check_limits(table: RegisterTable) -> None:
    if table.lowest is not None and table.highest is not None and table.lowest >= table.highest:
        limits_found = f"lowest = {table.lowest:g} and highest = {table.highest:g}"
        raise TableMistake("lowest", limits_found, "lowest below highest")
