"""The plant file that reads the simulated device."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from stemwatch.connectors.settings import toml_value
from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator import PlantLoop
from stemwatch.service.modbus_plant.register_layout import (
    ServedRegister,
    registers,
    signals,
    tag,
    unit,
)

NAME = "plc-1"


def plant_toml(
    loops: Sequence[PlantLoop],
    *,
    host: str,
    port: int,
    every_s: float = 1.0,
    name: str = "Simulated plant",
    zone: str = "Europe/Berlin",
    strokes: Mapping[str, str] | None = None,
) -> str:
    """A whole ``plant.toml``: one device with a register for each signal, and the valves on it.

    ``strokes`` gives, by the loop's tag, the full travel of its valve with the unit (``"40 mm"``).
    """
    lines = ["[plant]", f"name = {toml_value(name)}", f"zone = {toml_value(zone)}", ""]
    lines += device_toml(loops, host=host, port=port, every_s=every_s)
    for loop in loops:
        lines += ["", *_valve(loop, (strokes or {}).get(loop.tag))]
    return "\n".join(lines) + "\n"


def device_toml(
    loops: Sequence[PlantLoop], *, host: str, port: int, every_s: float = 1.0
) -> list[str]:
    """The lines of the ``[[devices]]`` table alone."""
    lines = [
        "[[devices]]",
        f"name = {toml_value(NAME)}",
        'type = "tcp"',
        f"host = {toml_value(host)}",
        f"port = {port}",
        "unit_id = 1",
        f"every_s = {every_s}",
        'byte_order = "ABCD"',
    ]
    for register in registers(loops):
        lines += ["", *_register(register)]
    return lines


def _register(register: ServedRegister) -> Iterator[str]:
    yield "[[devices.registers]]"
    yield f"tag = {toml_value(register.tag)}"
    yield 'register = "holding"'
    yield f"address = {register.address}"
    yield f"type = {toml_value(register.kind)}"
    if register.role is Role.MODE:
        yield "invalid = [65535]"
        return
    yield f"unit = {toml_value(register.unit)}"
    if register.role in (Role.OP, Role.MV):
        yield "lowest = -10.0"
        yield "highest = 110.0"


def _valve(loop: PlantLoop, stroke: str | None) -> Iterator[str]:
    yield "[[valves]]"
    yield f"id = {toml_value(loop.tag)}"
    yield f"description = {toml_value(loop.description)}"
    yield f"area = {toml_value(loop.area)}"
    yield f"criticality = {loop.criticality}"
    if stroke is not None:
        yield f"stroke = {toml_value(stroke)}"
    yield f"source = {toml_value(NAME)}"
    for role in signals(loop):
        yield f"[valves.tags.{role.value}]"
        yield f"tag = {toml_value(tag(loop, role))}"
        if role in (Role.PV, Role.SP):
            yield f"unit = {toml_value(unit(loop, role))}"
            yield f"low = {float(loop.pv_range.low)}"
            yield f"high = {float(loop.pv_range.high)}"
        elif role is not Role.MODE:
            yield 'unit = "%"'
