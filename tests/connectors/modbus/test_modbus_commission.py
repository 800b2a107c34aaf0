"""Trying registers and a map against a device, as at commissioning."""

from __future__ import annotations

import asyncio

import pytest
from pymodbus.constants import ExcCodes

from stemwatch.connectors.modbus.commissioning import (
    TriedRegister,
    interpretations,
    other_orders,
    read_raw_words,
    try_map,
)
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType
from stemwatch.connectors.modbus.read_fault import ReadFault
from stemwatch.connectors.modbus.register_address import RegisterAddress, Table
from tests.connectors.modbus.loopback_servers import (
    Behaviour,
    device,
    register,
    serving,
    sim_device,
    tcp,
)


def test_every_type_and_order_is_shown_and_the_right_one_looks_likely() -> None:
    """-37.625 word-swapped: of the four orders of FLOAT32 one is likely."""
    as_list = list(interpretations([0x8000, 0xC216, 0, 0]))
    floats = {m.order: m for m in as_list if m.kind is DataType.FLOAT32}
    assert floats[ByteOrder.CDAB].value == -37.625
    assert [order for order, m in floats.items() if m.likely] == [ByteOrder.CDAB]
    kinds = {m.kind for m in as_list}
    assert kinds == set(DataType)
    assert {m.order for m in as_list if m.kind is DataType.INT16} == {
        ByteOrder.ABCD,
        ByteOrder.BADC,
    }


def test_what_does_not_fit_is_left_out() -> None:
    """Two registers hold no 64 bits."""
    assert {m.kind.words for m in interpretations([1, 2])} == {1, 2}


def test_raw_words_are_read_once() -> None:
    """As they stand in the device."""

    async def run() -> list[int]:
        async with serving(sim_device(1, Behaviour(inputs={7: 0xABCD}))) as served:
            return await read_raw_words(tcp(served.port), 1, RegisterAddress(Table.INPUT, 6), 3)

    assert asyncio.run(run()) == [0, 0xABCD, 0]


@pytest.mark.parametrize(("first", "count"), [(0, 126), (0, 0), (65_530, 7)])
def test_a_count_that_no_request_can_have_is_refused(first: int, count: int) -> None:
    """Before anything is sent."""
    with pytest.raises(ValueError, match="1 to 125"):
        asyncio.run(read_raw_words(tcp(1), 1, RegisterAddress(Table.HOLDING, first), count))


def test_a_map_is_tried_register_by_register_where_the_device_refuses() -> None:
    """Words and value of each, or the reason; in the order of the map."""
    behaviour = Behaviour(
        holding={0: 0x8000, 1: 0xC216, 9: 250}, refuses={5: ExcCodes.ILLEGAL_ADDRESS}
    )
    registers = (
        register("ZT", 9, scale=0.1),
        register("GONE", 5),
        register("PV", 0, DataType.FLOAT32, order=ByteOrder.CDAB),
        register("SWAPPED", 0, DataType.FLOAT32),
    )

    async def run() -> list[TriedRegister]:
        async with serving(sim_device(1, behaviour)) as served:
            return await try_map(device(tcp(served.port), *registers))

    position, removed, right, swapped = asyncio.run(run())
    assert (position.words, position.reading.value) == ((250,), 25.0)
    assert (removed.words, removed.fault) == ((), "exception 2 (illegal data address)")
    assert right.reading.value == -37.625
    assert other_orders(right) == other_orders(removed) == other_orders(position) == ()
    assert [(m.order, m.value) for m in other_orders(swapped)] == [(ByteOrder.CDAB, -37.625)]


def test_a_device_that_is_not_there_is_a_fault() -> None:
    """Not a table of faults."""
    with pytest.raises(ReadFault, match="refused"):
        asyncio.run(try_map(device(tcp(1), register("T", 0))))
