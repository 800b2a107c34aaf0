"""How registers of 16 bits become numbers: eight types, four orders of bytes and words."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import StrEnum

Number = int | float


class DataType(StrEnum):
    """What a register, or a run of registers, holds."""

    INT16 = "INT16"
    UINT16 = "UINT16"
    INT32 = "INT32"
    UINT32 = "UINT32"
    INT64 = "INT64"
    UINT64 = "UINT64"
    FLOAT32 = "FLOAT32"
    FLOAT64 = "FLOAT64"

    @property
    def words(self) -> int:
        """How many registers it takes: 1, 2 or 4."""
        return int(self.value[-2:]) // 16

    @property
    def is_float(self) -> bool:
        """Whether it can hold a fraction, NaN or infinity."""
        return self.value.startswith("FLOAT")


class ByteOrder(StrEnum):
    """Where the most significant byte A of a value ``A B C D`` stands in the registers.

    Of 64 bits, CDAB has the four words in reverse, BADC the two bytes of each word, DCBA both.
    For a value of one register only the order of its bytes matters.
    """

    ABCD = "ABCD"  # most significant word first: big-endian
    CDAB = "CDAB"  # least significant word first, bytes in place
    BADC = "BADC"  # most significant word first, bytes swapped
    DCBA = "DCBA"  # little-endian throughout

    @property
    def swaps_bytes(self) -> bool:
        """Whether the two bytes of each word change places."""
        return self in (ByteOrder.BADC, ByteOrder.DCBA)

    @property
    def reverses_words(self) -> bool:
        """Whether the words stand in reverse."""
        return self in (ByteOrder.CDAB, ByteOrder.DCBA)


_STRUCTS = {
    DataType.INT16: struct.Struct(">h"),
    DataType.UINT16: struct.Struct(">H"),
    DataType.INT32: struct.Struct(">i"),
    DataType.UINT32: struct.Struct(">I"),
    DataType.INT64: struct.Struct(">q"),
    DataType.UINT64: struct.Struct(">Q"),
    DataType.FLOAT32: struct.Struct(">f"),
    DataType.FLOAT64: struct.Struct(">d"),
}
_WORDS = {count: struct.Struct(f">{count}H") for count in (1, 2, 4)}
_SWAPPED = {count: struct.Struct(f"<{count}H") for count in (1, 2, 4)}


def decode(words: Sequence[int], kind: DataType, order: ByteOrder) -> Number:
    """The number that ``words`` (each 0 to 65535, as many as ``kind`` takes) hold.

    Raises ``struct.error`` for a wrong count of words.
    """
    if order.reverses_words:
        words = words[::-1]
    packers = _SWAPPED if order.swaps_bytes else _WORDS
    number: Number = _STRUCTS[kind].unpack(packers[kind.words].pack(*words))[0]
    return number


def encode(value: Number, kind: DataType, order: ByteOrder) -> tuple[int, ...]:
    """The words that ``decode`` turns into ``value``; integers are rounded.

    Raises ``struct.error`` for a number that ``kind`` cannot hold.
    """
    number = value if kind.is_float else round(value)
    unpackers = _SWAPPED if order.swaps_bytes else _WORDS
    words: tuple[int, ...] = unpackers[kind.words].unpack(_STRUCTS[kind].pack(number))
    return words[::-1] if order.reverses_words else words
