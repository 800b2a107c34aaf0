"""docs/modbus.md against the code."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel

from stemwatch.connectors.modbus import read_devices
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType, encode
from stemwatch.connectors.modbus.device_tables import DeviceTable, RegisterTable

PAGE = (Path(__file__).parents[3] / "docs" / "modbus.md").read_text("utf-8")


@pytest.mark.parametrize("model", [DeviceTable, RegisterTable])
def test_every_key_is_described(model: type[BaseModel]) -> None:
    """Each key that a map may have stands in the table of its section."""
    section = PAGE.split("### `[[devices]]`" if model is DeviceTable else "registers]]`\n")[1]
    keys = {field.alias or name for name, field in model.model_fields.items()}
    described = set(re.findall(r"`(\w+)`", section.split("\n## ")[0]))
    assert keys - described == set()


def test_the_defaults_that_are_stated_are_the_ones_in_force() -> None:
    """A number in the default column is what a device gets that does not name it."""
    stated = dict(re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", PAGE, re.MULTILINE))
    assert len(stated) >= 6
    for key, value in stated.items():
        assert DeviceTable.model_fields[key].default == float(value), key


def test_the_map_that_is_shown_is_understood() -> None:
    """The example has no mistake."""
    (block,) = re.findall(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    devices = read_devices(tomllib.loads(block)["devices"])
    assert devices.problems == ()
    assert [register.first for register in devices.devices[0].registers] == [0, 11]


@pytest.mark.parametrize("order", ByteOrder)
def test_the_orders_that_are_shown_are_right(order: ByteOrder) -> None:
    """-37.625 in the four orders."""
    text = " ".join(f"{word:04X}" for word in encode(-37.625, DataType.FLOAT32, order))
    assert f"| `{order.value}` | `{text}` |" in PAGE
