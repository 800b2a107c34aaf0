"""From a register's table to its ``Register``."""

from __future__ import annotations

import re

from stemwatch.connectors.modbus.address import LAST_ADDRESS, parse_address
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType
from stemwatch.connectors.modbus.device import LinkKind
from stemwatch.connectors.modbus.faulty import Mistake
from stemwatch.connectors.modbus.register import Register
from stemwatch.connectors.modbus.tables import DeviceTable, RegisterTable

_HEX_WORDS = re.compile(r"0x([0-9a-fA-F]{4}(?:[ _]?[0-9a-fA-F]{4})*)")


def register_of(table: RegisterTable, device: DeviceTable) -> Register:
    """The register that ``table`` describes, with what ``device`` says for all of its own.

    Raises ``Mistake`` for values that contradict one another and ``AddressError`` for an address
    that cannot be understood or has two readings.
    """
    address = parse_address(table.address, table.memory)
    if address.offset + table.type.words - 1 > LAST_ADDRESS:
        found = f"{table.address!r}, so that a {table.type.value} ends beyond {LAST_ADDRESS}"
        raise Mistake("address", found, f"an address up to {LAST_ADDRESS + 1 - table.type.words}")
    unit_id = device.unit_id if table.unit_id is None else table.unit_id
    if unit_id == 0 and device.type is not LinkKind.TCP:
        key = "unit_id" if table.unit_id is not None else "tag"
        raise Mistake(key, "unit id 0, the broadcast that no unit answers on RTU", "1 to 255")
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
        raise Mistake("byte_order", f"nothing, for a {table.type.value} of several words", expected)
    return order or ByteOrder.ABCD


def _scaling(table: RegisterTable) -> tuple[float, float]:
    """``(scale, offset)`` of ``raw * scale + offset``."""
    if (table.raw is None) != (table.engineering is None):
        given, other = ("raw", "engineering") if table.raw else ("engineering", "raw")
        raise Mistake(given, f"{given} without {other}", "both, or neither")
    if table.raw is None or table.engineering is None:
        scale = 1.0 if table.scale is None else table.scale
        if scale == 0.0:
            raise Mistake("scale", "0, which makes every value the same", "a number that is not 0")
        return scale, table.offset or 0.0
    for key in ("scale", "offset"):
        if getattr(table, key) is not None:
            raise Mistake(key, f"{key} beside raw and engineering", "one way of scaling")
    (raw_low, raw_high), (low, high) = table.raw, table.engineering
    if raw_low == raw_high or low == high:
        key = "raw" if raw_low == raw_high else "engineering"
        raise Mistake(key, f"twice {getattr(table, key)[0]:g}", "two different numbers")
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
    found = _HEX_WORDS.fullmatch(text.strip())
    digits = re.sub("[ _]", "", found[1]) if found else ""
    if len(digits) != 4 * kind.words:
        expected = f"{kind.words} words of 4 hexadecimal digits as they stand in the registers, "
        expected += f'such as "0x{" ".join(["7FFF", "FFFF", "FFFF", "FFFF"][: kind.words])}"'
        raise Mistake("invalid", f"{text!r}", expected)
    return tuple(int(digits[i : i + 4], 16) for i in range(0, len(digits), 4))


def _check_limits(table: RegisterTable) -> None:
    if table.lowest is not None and table.highest is not None and table.lowest >= table.highest:
        found = f"lowest = {table.lowest:g} and highest = {table.highest:g}"
        raise Mistake("lowest", found, "lowest below highest")
