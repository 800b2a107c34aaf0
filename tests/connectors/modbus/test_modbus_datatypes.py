"""Types and byte orders, against worked values and against themselves."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType, decode, encode

ABCD, CDAB, BADC, DCBA = (ByteOrder[name] for name in ("ABCD", "CDAB", "BADC", "DCBA"))
_INTEGERS = {
    kind: st.integers(*((0, 2**bits - 1) if kind.name[0] == "U" else (-(2 ** (bits - 1)), -1)))
    for kind in DataType
    if not kind.is_float
    for bits in [kind.words * 16]
}


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (ABCD, (0xC216, 0x8000)),
        (CDAB, (0x8000, 0xC216)),
        (BADC, (0x16C2, 0x0080)),
        (DCBA, (0x0080, 0x16C2)),
    ],
)
def test_a_float_of_known_bytes_is_read_in_each_order(order: ByteOrder, words) -> None:
    """-37.625 is C2 16 80 00."""
    assert decode(words, DataType.FLOAT32, order) == -37.625
    assert encode(-37.625, DataType.FLOAT32, order) == words


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (ABCD, (0x0102, 0x0304, 0x0506, 0x0708)),
        (CDAB, (0x0708, 0x0506, 0x0304, 0x0102)),
        (BADC, (0x0201, 0x0403, 0x0605, 0x0807)),
        (DCBA, (0x0807, 0x0605, 0x0403, 0x0201)),
    ],
)
def test_four_words_keep_the_pattern(order: ByteOrder, words) -> None:
    """Words reversed, bytes swapped, or both, as in two words."""
    assert decode(words, DataType.UINT64, order) == 0x0102030405060708


@pytest.mark.parametrize(
    ("kind", "words", "expected"),
    [
        (DataType.INT16, (0xFFFF,), -1),
        (DataType.UINT16, (0xFFFF,), 65535),
        (DataType.INT32, (0x8000, 0x0000), -(2**31)),
        (DataType.UINT32, (0x8000, 0x0000), 2**31),
        (DataType.INT64, (0xFFFF, 0xFFFF, 0xFFFF, 0xFFFE), -2),
        (DataType.FLOAT64, (0xC042, 0xD000, 0x0000, 0x0000), -37.625),
    ],
)
def test_the_sign_belongs_to_the_type(kind: DataType, words, expected) -> None:
    """The same bits are another number in another type."""
    assert decode(words, kind, ABCD) == expected


@pytest.mark.parametrize("order", ByteOrder)
@pytest.mark.parametrize("kind", [kind for kind in DataType if not kind.is_float])
@settings(max_examples=25)
@given(data=st.data())
def test_integers_come_back(kind: DataType, order: ByteOrder, data) -> None:
    """What is encoded is decoded, over the whole range of the type."""
    value = data.draw(_INTEGERS[kind])
    words = encode(value, kind, order)
    assert len(words) == kind.words
    assert decode(words, kind, order) == value


@pytest.mark.parametrize("order", ByteOrder)
@given(st.floats(allow_nan=True))
def test_doubles_come_back(order: ByteOrder, value: float) -> None:
    """Infinities and NaN among them."""
    repeated = decode(encode(value, DataType.FLOAT64, order), DataType.FLOAT64, order)
    assert repeated == value or (math.isnan(repeated) and math.isnan(value))


def test_one_register_knows_swapped_bytes_only() -> None:
    """CDAB is ABCD there, and DCBA is BADC."""
    assert [decode((0x0102,), DataType.UINT16, o) for o in (ABCD, CDAB)] == [0x0102] * 2
    assert [decode((0x0102,), DataType.UINT16, o) for o in (BADC, DCBA)] == [0x0201] * 2


def test_a_wrong_count_of_words_is_no_number() -> None:
    """Nothing is made up of half a value."""
    with pytest.raises(struct.error):
        decode((1,), DataType.FLOAT32, ABCD)
