"""The tables ``[[devices]]`` and ``[[devices.registers]]`` of a plant file.

Each field's description is what an error says was expected.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from stemwatch.connectors.modbus.address import Table
from stemwatch.connectors.modbus.blocks import MAX_WORDS
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType
from stemwatch.connectors.modbus.device import DEFAULT_PORT, FASTEST_S, SLOWEST_S, LinkKind


def _upper(value: Any) -> Any:
    return value.strip().upper() if isinstance(value, str) else value


def _member(kind: type[StrEnum], in_file: Callable[[str], str]) -> BeforeValidator:
    """A text in any case as the member of ``kind``; strict tables take nothing but members."""

    def convert(value: Any) -> Any:
        return kind(in_file(value.strip())) if isinstance(value, str) else value

    return BeforeValidator(convert)


class _Table(BaseModel):
    """A TOML table: no unknown keys, no silent conversion of one type into another."""

    model_config = ConfigDict(
        extra="forbid", strict=True, frozen=True, allow_inf_nan=False, str_strip_whitespace=True
    )


Name = Annotated[str, Field(min_length=1, max_length=200)]
UnitId = Annotated[int, Field(ge=0, le=255)]
Kind = Annotated[DataType, _member(DataType, str.upper)]
Order = Annotated[ByteOrder, _member(ByteOrder, str.upper)]
Memory = Annotated[Table, _member(Table, str.lower)]
Carrier = Annotated[LinkKind, _member(LinkKind, str.lower)]
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]

_ORDERS = "ABCD, CDAB, BADC or DCBA"


class RegisterTable(_Table):
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


class DeviceTable(_Table):
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
