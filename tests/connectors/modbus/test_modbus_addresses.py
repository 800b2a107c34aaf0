"""Addresses: every way of writing them that people know, and refusal where two are meant."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.connectors.modbus.register_address import (
    AddressError,
    RegisterAddress,
    Table,
    parse_address,
)

HOLDING, INPUT = Table.HOLDING, Table.INPUT


@pytest.mark.parametrize(
    ("written", "table", "expected"),
    [
        (0, HOLDING, RegisterAddress(HOLDING, 0)),
        (11, INPUT, RegisterAddress(INPUT, 11)),
        ("0x000B", HOLDING, RegisterAddress(HOLDING, 11)),
        ("40001", None, RegisterAddress(HOLDING, 0)),
        ("400001", None, RegisterAddress(HOLDING, 0)),
        ("30013", None, RegisterAddress(INPUT, 12)),
        ("465536", None, RegisterAddress(HOLDING, 65535)),
        ("HR1", None, RegisterAddress(HOLDING, 0)),
        ("hrf3", None, RegisterAddress(HOLDING, 2)),
        ("IR10", None, RegisterAddress(INPUT, 9)),
        ("40001", HOLDING, RegisterAddress(HOLDING, 0)),
        (8289, HOLDING, RegisterAddress(HOLDING, 8289)),
        (50_000, HOLDING, RegisterAddress(HOLDING, 50_000)),
        (40_001, INPUT, RegisterAddress(INPUT, 40_001)),  # 4xxxx are never input registers
    ],
)
def test_an_address_is_understood(written, table, expected) -> None:
    """Counted from 0 with the table apart, or from 1 with the table in front."""
    assert parse_address(written, table) == expected


@pytest.mark.parametrize(("number", "table"), [(40001, HOLDING), (40001, None), (30101, INPUT)])
def test_a_number_with_two_readings_is_refused_with_both(number: int, table) -> None:
    """The sentence names the Modicon register and the protocol address, each ready to copy."""
    with pytest.raises(AddressError) as caught:
        parse_address(number, table)
    text = str(caught.value)
    assert f'address = "{number}" (a text)' in text
    assert f"which the protocol calls {number % 10000 - 1}" in text
    assert f'address = "0x{number:X}"' in text
    assert f"the protocol's own address {number}, counted from 0" in text


@pytest.mark.parametrize("number", [40001, 30101, 49999])
def test_both_readings_that_are_offered_are_understood(number: int) -> None:
    """What the refusal says to write is taken, and means what it says."""
    table = HOLDING if number >= 40_000 else INPUT
    assert parse_address(str(number)).offset == number % 10_000 - 1
    assert parse_address(f"0x{number:X}", table).offset == number


@pytest.mark.parametrize(
    ("written", "table", "text"),
    [
        (5, None, "without its table"),
        (70_000, HOLDING, "0 to 65535"),
        (400_001, HOLDING, "beyond the protocol's 65535"),
        (-1, HOLDING, "0 to 65535"),
        (True, HOLDING, "True"),
        (1.5, HOLDING, "1.5"),
        ("41", None, "five or six digits"),
        ("40000", None, "'40001' or more"),
        ("HR0", None, "counts from 1"),
        ("10001", None, "a discrete input"),
        ("00001", None, "a coil"),
        ("30001", HOLDING, 'register = "input"'),
        ("465537", None, "0 to 65535"),
        ("٤٠٠٠١", None, "the address"),
        ("", None, "the address ''"),
    ],
)
def test_what_cannot_be_understood_is_refused_with_a_reason(written, table, text: str) -> None:
    """The sentence says what was found and what would be right."""
    with pytest.raises(AddressError, match="expected") as caught:
        parse_address(written, table)
    assert text in str(caught.value)


@given(st.integers(0, 65_535), st.sampled_from(Table))
def test_the_modicon_form_means_the_same_register(offset: int, table: Table) -> None:
    """What is shown beside each address can be written into a map."""
    address = RegisterAddress(table, offset)
    assert parse_address(address.modicon) == address
