"""Register addresses: one form inside the program, several ways to write them in the field.

The protocol counts from 0 and names the table separately. Most manuals print Modicon numbers, which
count from 1 and begin with the table: 40001 is the first holding register. A number that can be
read both ways is refused with both readings.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum

LAST_ADDRESS = 65_535


class Table(StrEnum):
    """Which registers; coils and discrete inputs hold no numbers and are not read."""

    HOLDING = "holding"  # function 3
    INPUT = "input"  # function 4


FUNCTION = {Table.HOLDING: 3, Table.INPUT: 4}


class AddressError(ValueError):
    """An address that cannot be understood. ``found`` and ``expected`` are halves of a sentence."""

    def __init__(self, found: str, expected: str) -> None:
        self.found, self.expected = found, expected
        super().__init__(f"found {found}; expected {expected}")


@dataclass(frozen=True, order=True)
class RegisterAddress:
    """A register as the protocol has it: its table and a number from 0 to 65535."""

    table: Table
    offset: int

    def __str__(self) -> str:
        return f"{self.table.value} {self.offset}"

    @property
    def modicon(self) -> str:
        """The same register as most manuals print it, counted from 1: ``40001``, ``465536``."""
        digit = _DIGIT[self.table]
        number = self.offset + 1
        return f"{digit}{number:04}" if number <= 9999 else f"{digit}{number:05}"


_DIGIT = {Table.HOLDING: "4", Table.INPUT: "3"}
_TABLE = {digit: table for table, digit in _DIGIT.items()}
_LETTERED = re.compile(r"(HR|IR)F?(\d{1,5})", re.IGNORECASE)
_LETTERS = {"HR": Table.HOLDING, "IR": Table.INPUT}
_HEX = re.compile(r"0x([0-9a-f]{1,4})", re.IGNORECASE)
_WAYS = (
    'register = "holding" or "input" with address counted from 0, or one text counted from 1 such '
    'as "40001", "300012" or "HR1"'
)


def parse_address(written: int | str, table: Table | None = None) -> RegisterAddress:
    """The register that ``written`` means.

    An integer counts from 0 and needs ``table``, as does a hexadecimal text such as ``"0x000B"``.
    A text of five or six digits is a Modicon number, ``HR1`` and ``IR1`` (``HRF1`` and ``IRF1`` for
    floats) are those of Ignition; both count from 1 and bring their table. Raises ``AddressError``
    for anything else, and with both readings for an integer that looks like a Modicon number.
    """
    if isinstance(written, int) and not isinstance(written, bool):
        return _from_zero(written, table)
    if isinstance(written, str):
        text = written.strip()
        if match := _HEX.fullmatch(text):
            return _checked(int(match[1], 16), table, written)
        if match := _LETTERED.fullmatch(text):
            return _from_one(int(match[2]), _LETTERS[match[1].upper()], table, written)
        if text.isascii() and text.isdigit():
            return _modicon(text, table)
    raise AddressError(f"the address {written!r}", _WAYS)


def _from_zero(number: int, table: Table | None) -> RegisterAddress:
    for digit, candidate in _TABLE.items():
        offset = _place_in(str(number), digit)
        if offset and table in (None, candidate):
            raise _ambiguous(number, offset, candidate)
    return _checked(number, table, number)


def _place_in(text: str, digit: str) -> int:
    """The place, counted from 1, that a Modicon number of this table names; 0 for other numbers."""
    if len(text) not in (5, 6) or text[0] != digit:
        return 0
    number = int(text[1:])
    return number if number <= LAST_ADDRESS + 1 else 0


def _ambiguous(number: int, offset: int, meant_table: Table) -> AddressError:
    modicon = (
        f'address = "{number}" (a text) for {meant_table.value} register {offset} counted from 1, '
    )
    modicon += f"which the protocol calls {offset - 1}"
    if number > LAST_ADDRESS:
        return AddressError(f"the number {number}, beyond the protocol's {LAST_ADDRESS}", modicon)
    advice = f'or register = "{meant_table.value}" with address = "0x{number:X}" for the '
    advice += f"protocol's own address {number}, counted from 0"
    return AddressError(f"the number {number}, which has two readings", f"{modicon}; {advice}")


def _modicon(text: str, table: Table | None) -> RegisterAddress:
    if len(text) in (5, 6) and text[0] in "01":
        expected = "a holding or input register: coils and discrete inputs hold no numbers"
        raise AddressError(
            f"{text!r}, a {'coil' if text[0] == '0' else 'discrete input'}", expected
        )
    if len(text) not in (5, 6) or text[0] not in _TABLE:
        raise AddressError(
            f"the text {text!r}", f"five or six digits that begin with 3 or 4; {_WAYS}"
        )
    number = int(text[1:])
    meant_table = _TABLE[text[0]]
    if number == 0:
        first = f"{text[:-1]}1"
        raise AddressError(f"{text!r}", f"{first!r} or more: Modicon numbers count from 1")
    return _from_one(number, meant_table, table, text)


def _from_one(
    number: int, meant_table: Table, table: Table | None, written: str
) -> RegisterAddress:
    if table not in (None, meant_table):
        found_text = (
            f"{written!r}, a register of the {meant_table.value} table, beside another table"
        )
        raise AddressError(
            found_text, f'register = "{meant_table.value}", or no register beside this address'
        )
    if number == 0:
        raise AddressError(f"{written!r}", "1 or more: this way of writing counts from 1")
    return _checked(number - 1, meant_table, written)


def _checked(number: int, table: Table | None, written: int | str) -> RegisterAddress:
    if table is None:
        found_text = f"the address {written!r} without its table"
        raise AddressError(found_text, _WAYS)
    if not 0 <= number <= LAST_ADDRESS:
        raise AddressError(f"the address {written!r}", f"0 to {LAST_ADDRESS}, counted from 0")
    return RegisterAddress(table, number)
