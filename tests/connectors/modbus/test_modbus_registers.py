"""What a register's words say: engineering units, or a reason why there is no value."""

from __future__ import annotations

import math

import pytest

from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType, encode
from stemwatch.connectors.modbus.register import NOT_A_NUMBER, WRONG_ORDER
from stemwatch.models.recording import Quality
from tests.connectors.modbus.loopback_servers import register

FLOAT = DataType.FLOAT32


def test_raw_becomes_engineering_units() -> None:
    """raw * scale + offset."""
    reading = register("ZT", 3, DataType.INT16, scale=0.1, offset=-5.0).read([1000])
    assert reading.value == pytest.approx(95.0)
    assert reading[1:] == (Quality.GOOD, "")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"invalid": frozenset({65535.0})}, [0xFFFF]),
        ({"invalid_words": frozenset({(0x7FFF,)})}, [0x7FFF]),
    ],
)
def test_what_the_device_calls_invalid_is_bad(more, words) -> None:
    """65535 for "not available" must not become 100 %."""
    reading = register("ZT", 0, **more).read(words)
    assert math.isnan(reading.value)
    assert reading.quality == Quality.BAD
    assert "device says" in reading.reason


def test_words_tell_one_nan_from_another() -> None:
    """A text in the list of invalid values is compared as the registers hold it, in any order."""
    item = register("PV", 0, FLOAT, order=ByteOrder.CDAB, invalid_words=frozenset({(1, 0x4148)}))
    assert item.read([1, 0x4148]).quality == Quality.BAD
    assert item.read([0, 0x4148]).value == 12.5


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_bad(value: float) -> None:
    """NaN and infinity are how floats say that there is nothing."""
    reading = register("PV", 0, FLOAT).read(encode(value, FLOAT, ByteOrder.ABCD))
    assert reading[1:] == (Quality.BAD, NOT_A_NUMBER)


def test_an_overflow_of_the_scale_is_no_number() -> None:
    """No infinity gets into a recording."""
    kind = DataType.FLOAT64
    reading = register("PV", 0, kind, scale=10.0).read(encode(1e308, kind, ByteOrder.ABCD))
    assert reading[1:] == (Quality.BAD, NOT_A_NUMBER)


def test_a_float_in_the_wrong_order_is_not_a_closed_valve() -> None:
    """-37.625 read word-swapped is a denormal, and would be zero on every chart."""
    swapped = register("PV", 0, FLOAT, order=ByteOrder.CDAB).read([0xC216, 0x8000])
    assert swapped[1:] == (Quality.CODE, WRONG_ORDER)
    assert register("PV", 0, FLOAT).read([0, 0]) == (0.0, Quality.GOOD, "")


@pytest.mark.parametrize(("raw", "text"), [(90, "below"), (1110, "above")])
def test_a_value_out_of_range_is_marked(raw: int, text: str) -> None:
    """The limits are in engineering units."""
    reading = register("ZT", 0, scale=0.1, lowest=10.0, highest=110.0).read([raw])
    assert math.isnan(reading.value)
    assert reading.quality == Quality.RANGE
    assert text in reading.reason


def test_the_limits_themselves_are_in_range() -> None:
    """From lowest to highest, both included."""
    item = register("ZT", 0, lowest=0.0, highest=100.0)
    assert [item.read([raw]).quality for raw in (0, 100)] == [Quality.GOOD] * 2
