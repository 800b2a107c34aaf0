"""Blocks: every register in exactly one, none too long, none across a wide hole."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.connectors.modbus.block_reader import BlockReader, Columns
from stemwatch.connectors.modbus.blocks import Block, plan_blocks
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType
from stemwatch.connectors.modbus.register_address import Table
from tests.connectors.modbus.loopback_servers import register

MAPS = st.lists(
    st.tuples(
        st.integers(0, 600),
        st.sampled_from(DataType),
        st.sampled_from(Table),
        st.integers(1, 2),
    ),
    min_size=1,
    max_size=60,
).map(
    lambda rows: [
        register(f"T{i}", offset, kind, table=table, unit_id=unit)
        for i, (offset, kind, table, unit) in enumerate(rows)
    ]
)


@given(MAPS, st.integers(4, 125), st.integers(0, 30))
def test_a_plan_reads_everything_once_within_the_limits(registers, max_words, max_gap) -> None:
    """No value is torn, no request is too long, no hole is wider than allowed."""
    blocks = plan_blocks(registers, max_words=max_words, max_gap=max_gap)
    assert sorted(r.tag for b in blocks for r in b.registers) == sorted(r.tag for r in registers)
    for block in blocks:
        assert 1 <= block.count <= max_words
        stop = block.first
        for polled in block.registers:
            assert (polled.unit_id, polled.address.table) == (block.unit_id, block.table)
            assert polled.first - stop <= max_gap
            words = block.words_of(polled, range(block.first, block.first + block.count))
            assert list(words) == list(range(polled.first, polled.stop))
            stop = max(stop, polled.stop)


@given(MAPS)
def test_halving_ends_at_registers_of_one_address(registers) -> None:
    """Every block can be divided until each part begins at one address, and nothing is lost."""

    def leaves(block: Block) -> list[Block]:
        halves = block.halves()
        return [block] if halves is None else [*leaves(halves[0]), *leaves(halves[1])]

    for block in plan_blocks(registers, max_gap=125):
        parts = leaves(block)
        assert sorted(r.tag for p in parts for r in p.registers) == sorted(
            r.tag for r in block.registers
        )
        assert all(len({r.first for r in part.registers}) == 1 for part in parts)


def test_a_block_is_first_divided_at_its_widest_hole() -> None:
    """Devices refuse the registers between two groups, not the groups."""
    registers = [register(f"T{i}", i) for i in (0, 1, 2, 3, 4, 10, 11)]
    (block,) = plan_blocks(registers, max_gap=8)
    left, right = block.halves()
    assert (left.first, left.count, right.first, right.count) == (0, 5, 10, 2)


def test_a_full_run_takes_as_few_requests_as_the_protocol_allows() -> None:
    """1500 floats side by side: 62 whole values fit into 125 words."""
    registers = [register(f"T{i}", 2 * i, DataType.FLOAT32) for i in range(1500)]
    assert len(plan_blocks(registers)) == -(-1500 // 62)


@pytest.mark.parametrize("limits", [{"max_words": 126}, {"max_words": 3}, {"max_gap": -1}])
def test_limits_that_no_request_can_keep_are_refused(limits) -> None:
    """125 words are the protocol's limit, and a 64-bit value needs 4."""
    with pytest.raises(ValueError, match="received"):
        plan_blocks([register("T", 0)], **limits)


SCALES = st.sampled_from([1.0, 0.1, -2.5, 1e300])
LIMITS = st.sampled_from([None, -50.0, 0.0, 100.0])
INVALID = st.sets(st.sampled_from([0.0, 65535.0, -1.0, 12.5]), max_size=2).map(frozenset)


@st.composite
def judged_registers(draw):
    """A register of any type, order, scale, limits and invalid values, at an address below 40."""
    return register(
        f"T{draw(st.integers(0, 10**9))}",
        draw(st.integers(0, 40)),
        draw(st.sampled_from(DataType)),
        order=draw(st.sampled_from(ByteOrder)),
        scale=draw(SCALES),
        offset=draw(st.sampled_from([0.0, -5.0])),
        lowest=draw(LIMITS),
        highest=draw(LIMITS),
        invalid=draw(INVALID),
        invalid_words=draw(st.sampled_from([frozenset(), frozenset({(0x7FFF,)})])),
    )


WORDS = st.sampled_from([0, 1, 0x3F80, 0x4148, 0x7F80, 0x7FC0, 0x7FFF, 0x8000, 0xFFFF])


@given(
    st.lists(judged_registers(), min_size=1, max_size=20, unique_by=lambda register: register.tag),
    st.lists(st.one_of(WORDS, st.integers(0, 65535)), min_size=50, max_size=50),
)
def test_a_block_is_read_as_its_registers_are(registers, memory) -> None:
    """Arrays and the definition agree on value, quality and reason, bit for bit."""
    (block,) = plan_blocks(registers, max_gap=50)
    place_of = {polled.tag: index for index, polled in enumerate(registers)}
    columns = Columns(len(registers))
    BlockReader(block, place_of).read(memory[block.first : block.first + block.count], columns)
    for index, polled in enumerate(registers):
        expected = polled.read(memory[polled.first : polled.stop])
        assert (columns.quality[index], columns.reasons[index]) == expected[1:]
        np.testing.assert_array_equal(columns.values[index], expected.value)


@pytest.mark.parametrize(
    ("avoided", "counts"),
    [
        ({3}, [4]),
        ({4}, [2, 2]),
        ({4, 2}, [1, 3]),
        ({4, 3, 2}, [1, 1, 1, 1]),
        ({4, 1, 2, 3}, [1, 1, 1, 1]),  # nothing is left; each piece is what cannot be divided
    ],
)
def test_a_block_is_divided_so_that_no_piece_has_a_length_to_avoid(avoided, counts) -> None:
    """As few pieces as will do, in the order of the addresses, with every register once."""
    (block,) = plan_blocks([register(f"T{i}", i) for i in range(4)])
    pieces = block.avoiding(avoided)
    assert [piece.count for piece in pieces] == counts
    assert [item.tag for piece in pieces for item in piece.registers] == ["T0", "T1", "T2", "T3"]
