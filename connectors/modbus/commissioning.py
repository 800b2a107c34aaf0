"""Commissioning: raw registers in every type and byte order, and a trial of a register map."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass

from stemwatch.connectors.modbus.blocks import MAX_WORDS, Block
from stemwatch.connectors.modbus.connection import Connection
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType, Number, decode
from stemwatch.connectors.modbus.device import Device, Link
from stemwatch.connectors.modbus.read_fault import ReadFault
from stemwatch.connectors.modbus.register import TINY, Reading, Register
from stemwatch.connectors.modbus.register_address import LAST_ADDRESS, RegisterAddress

# Beyond these a float is far more often a wrong order of bytes than a measurement.
_SMALLEST, _LARGEST = 1e-4, 1e7


@dataclass(frozen=True)
class Interpretation:
    """The value of words as ``kind`` in ``order``. ``likely`` is false for what is hardly a plant
    value: not finite, or far too small or too large."""

    kind: DataType
    order: ByteOrder
    value: Number
    likely: bool


@dataclass(frozen=True)
class TriedRegister:
    """One register of a map and the device's answer: words and reading, or the ``fault``."""

    register: Register
    words: tuple[int, ...] = ()
    reading: Reading | None = None
    fault: str = ""


def interpretations(words: Sequence[int]) -> Iterator[Interpretation]:
    """Every type that fits into ``words`` (from the first on), in every order.

    Of one register two orders differ, of more all four.
    """
    for kind in DataType:
        if kind.words > len(words):
            continue
        orders = tuple(ByteOrder) if kind.words > 1 else (ByteOrder.ABCD, ByteOrder.BADC)
        for order in orders:
            value = decode(words[: kind.words], kind, order)
            yield Interpretation(kind, order, value, _likely(value, kind))


def _likely(value: Number, kind: DataType) -> bool:
    if not kind.is_float:
        return abs(value) <= _LARGEST
    size = abs(value)
    return math.isfinite(size) and (size == 0.0 or _SMALLEST <= size <= _LARGEST)


async def read_raw_words(link: Link, unit_id: int, first: RegisterAddress, count: int) -> list[int]:
    """The ``count`` words from ``first`` on, 1 to 125.

    Raises ``ReadFault`` where the device cannot be reached or refuses, ``ValueError`` for a count
    out of range.
    """
    if not 1 <= count <= min(MAX_WORDS, LAST_ADDRESS + 1 - first.offset):
        raise ValueError(f"1 to {MAX_WORDS} registers up to {LAST_ADDRESS} are read, not {count}")
    async with _opened(link) as line:
        return await line.read(unit_id, first.table, first.offset, count)


async def try_map(device: Device) -> list[TriedRegister]:
    """Every register of ``device``, in the order of the map, read once in the blocks of a poll.

    Raises ``ReadFault`` where the device cannot be reached; what it refuses is in the result.
    """
    registers: dict[str, TriedRegister] = {}
    async with _opened(device.link) as line:
        for block in device.blocks():
            for answer in await _try_block(line, block):
                registers[answer.register.tag] = answer
    return [registers[tag] for tag in device.tags]


async def _try_block(line: Connection, block: Block) -> list[TriedRegister]:
    try:
        words = await line.read(block.unit_id, block.table, block.first, block.count)
    except ReadFault as fault:
        halves = block.halves() if fault.splits else None
        if halves is not None:
            return [register for half in halves for register in await _try_block(line, half)]
        if not await line.reopen():
            raise
        return [TriedRegister(register, fault=fault.reason) for register in block.registers]
    registers = []
    for register in block.registers:
        words_of_register = tuple(block.words_of(register, words))
        registers.append(
            TriedRegister(register, words_of_register, register.read(words_of_register))
        )
    return registers


def other_orders(register: TriedRegister) -> tuple[Interpretation, ...]:
    """Byte orders in which the words of ``register`` give a likely value where the map's does not.

    Empty where the map's order looks likely, or none does.
    """
    kind, order = register.register.kind, register.register.order
    if not register.words or kind.words == 1:
        return ()
    orders = [meaning for meaning in interpretations(register.words) if meaning.kind is kind]
    by_map = next(meaning for meaning in orders if meaning.order is order)
    tiny = kind.is_float and 0.0 < abs(by_map.value) < TINY
    if by_map.likely and not tiny:
        return ()
    return tuple(meaning for meaning in orders if meaning.likely and meaning.order is not order)


@asynccontextmanager
async def _opened(link: Link) -> AsyncIterator[Connection]:
    line = Connection(link)
    await line.open()
    try:
        yield line
    finally:
        line.close()
