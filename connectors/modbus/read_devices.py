"""``read_devices``: the ``[[devices]]`` of a plant file, with every mistake named.

A register that is wrong is left out and the others of its device are polled; a device that is wrong
is left out and the others run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from stemwatch.connectors.modbus.device import Device, LinkKind, poll_time_s
from stemwatch.connectors.modbus.device_tables import (
    DeviceTable,
    RegisterTable,
    TableMistake,
    link_of,
    register_of,
)
from stemwatch.connectors.modbus.register import Register
from stemwatch.connectors.modbus.register_address import AddressError
from stemwatch.connectors.modbus.register_list import ListUnusable, read_register_list
from stemwatch.connectors.settings import KeyPath, Problem, either_of, nearest

LineOf = Callable[[KeyPath], int | None]


@dataclass(frozen=True)
class DeviceMap:
    """The devices that can be polled, and one problem for each mistake in what was left out."""

    devices: tuple[Device, ...]
    problems: tuple[Problem, ...]


@dataclass
class _Reader:
    file: str
    line_of: LineOf
    folder: Path = Path()  # that names of files are relative to
    problems: list[Problem] = field(default_factory=list)

    def at_line(self, file: str, line: int | None) -> _Reader:
        """A reader of ``line`` of ``file`` that adds to the problems of this one."""
        return _Reader(file, lambda path: line, self.folder, self.problems)

    def add_problem(self, path: KeyPath, label: str, found: str, expected: str) -> None:
        """Add a problem at ``path``, which messages call ``label``."""
        line = self.line_of(path)
        problem = Problem(file=self.file, line=line, key=label, found=found, expected=expected)
        self.problems.append(problem)

    def table(
        self, model: type[BaseModel], table: Mapping[str, Any], path: KeyPath, label: str
    ) -> Any:
        """``table`` as ``model``, or ``None`` and its problems."""
        try:
            return model.model_validate(table)
        except ValidationError as error:
            reported: set[KeyPath] = set()
            for details in error.errors(include_url=False):
                # A union reports each of its branches; the field's description covers them all.
                row_key = tuple(details["loc"])[:1]
                if row_key not in reported:
                    reported.add(row_key)
                    self._explain(details, model, path, label)
            return None

    def _explain(
        self, details: ErrorDetails, model: type[BaseModel], path: KeyPath, label: str
    ) -> None:
        key = str(details["loc"][0]) if details["loc"] else ""
        key_path, name = (*path, key), f"{label}.{key}"
        fields = {field.alias or name: field for name, field in model.model_fields.items()}
        if details["type"] == "extra_forbidden":
            self.add_problem(
                key_path, name, "an unknown key", either_of(fields) + nearest(key, fields)
            )
            return
        found_text = "nothing" if details["type"] == "missing" else _described(details["input"])
        expected = fields[key].description if key in fields else None
        self.add_problem(key_path, name, found_text, expected or details["msg"])


def read_devices(
    tables: Sequence[Mapping[str, Any]],
    line_of: LineOf = lambda path: None,
    file: str = "plant.toml",
    folder: Path | None = None,
) -> DeviceMap:
    """The devices that ``tables`` (the value of ``[[devices]]``) describe.

    ``line_of`` gives the line of a key path such as ``("devices", 0, "registers", 3, "address")``;
    ``folder`` is where lists of registers are looked for (``registers = "registers.csv"``), the
    current one if left out. Nothing is raised for what is wrong in them: it is left out, and stands
    in ``problems`` with its file and line, what was found and what was expected.
    """
    reader = _Reader(file, line_of, folder or Path())
    devices: dict[str, Device] = {}
    for index, table in enumerate(tables):
        path = ("devices", index)
        name = table.get("name")
        label = f"devices[{name if isinstance(name, str) and name.strip() else index + 1}]"
        device = _device(reader, table, path, label)
        if device is None:
            continue
        if device.name in devices:
            found_text = f"{device.name!r}, which an earlier device has already"
            reader.add_problem((*path, "name"), f"{label}.name", found_text, "a name of its own")
            continue
        devices[device.name] = device
    return DeviceMap(tuple(devices.values()), tuple(reader.problems))


def _device(reader: _Reader, table: Mapping[str, Any], path: KeyPath, label: str) -> Device | None:
    rows = _rows(reader, table, path, label)
    if rows is None:
        return None
    if isinstance(table.get("registers"), str):
        table = {**table, "registers": [dict(row.table) for row in rows]}
    read: DeviceTable | None = reader.table(DeviceTable, table, path, label)
    if read is None:
        return None
    try:
        link = link_of(read)
    except TableMistake as mistake:
        reader.add_problem(
            (*path, mistake.key), f"{label}.{mistake.key}", mistake.found, mistake.expected
        )
        return None
    registers = _registers(rows, read)
    if not registers:
        reader.add_problem(path, label, "no register that can be read", "at least one")
        return None
    device = Device(
        name=read.name,
        link=link,
        registers=registers,
        every_s=read.every_s,
        max_words=read.max_words,
        max_gap=read.max_gap,
    )
    return device if _can_keep_pace(reader, device, path, label) else None


@dataclass(frozen=True)
class _Row:
    """A register's table, the reader that notes problems, its path, and its name in messages."""

    table: Mapping[str, Any]
    reader: _Reader
    path: KeyPath
    label: str


def _rows(
    reader: _Reader, table: Mapping[str, Any], path: KeyPath, label: str
) -> list[_Row] | None:
    """The registers of a device, from its tables or its list; ``None`` where the list cannot be
    used, which is noted as a problem."""
    registers = table.get("registers")
    if isinstance(registers, str) and registers.strip():
        return _rows_of_list(reader, registers.strip(), path, label)
    tables = registers if isinstance(registers, list) else []
    return [
        _Row(
            table, reader, (*path, "registers", index), f"{label}.registers[{_name(table, index)}]"
        )
        for index, table in enumerate(tables)
        if isinstance(table, Mapping)
    ]


def _rows_of_list(reader: _Reader, name: str, path: KeyPath, label: str) -> list[_Row] | None:
    try:
        register_list = read_register_list(reader.folder / name)
    except ListUnusable as mistake:
        if mistake.line is None:
            key = f"{label}.registers"
            reader.add_problem(
                (*path, "registers"), key, f"{name!r}: {mistake.found}", mistake.expected
            )
        else:
            key = f"column {mistake.key}" if mistake.key else "row"
            reader.at_line(name, mistake.line).add_problem((), key, mistake.found, mistake.expected)
        return None
    for line, found, expected in register_list.faulty:
        reader.at_line(name, line).add_problem((), "row", found, expected)
    if not register_list.rows:
        reader.add_problem(
            (*path, "registers"), f"{label}.registers", f"no row in {name!r}", "one or more"
        )
        return None
    return [
        _Row(row.table, reader.at_line(name, row.line), (), f"registers[{_name(row.table, index)}]")
        for index, row in enumerate(register_list.rows)
    ]


def _name(table: Mapping[str, Any], index: int) -> str | int:
    tag = table.get("tag")
    return tag if isinstance(tag, str) and tag.strip() else index + 1


def _registers(rows: Sequence[_Row], device: DeviceTable) -> tuple[Register, ...]:
    registers: dict[str, Register] = {}
    for register, row in _each_register(rows, device):
        if register.tag in registers:
            found_text = f"{register.tag!r}, which an earlier register of this device has already"
            row.reader.add_problem(
                (*row.path, "tag"), f"{row.label}.tag", found_text, "a tag of its own"
            )
        else:
            registers[register.tag] = register
    return tuple(registers.values())


def _each_register(rows: Sequence[_Row], device: DeviceTable) -> Iterator[tuple[Register, _Row]]:
    """Each register that is right, with its row."""
    for row in rows:
        add_problem, inner, label = row.reader.add_problem, row.path, row.label
        read: RegisterTable | None = row.reader.table(RegisterTable, row.table, inner, label)
        if read is None:
            continue
        try:
            yield register_of(read, device), row
        except TableMistake as mistake:
            key = (*inner, mistake.key)
            add_problem(key, f"{label}.{mistake.key}", mistake.found, mistake.expected)
        except AddressError as error:
            add_problem((*inner, "address"), f"{label}.address", error.found, error.expected)


def _can_keep_pace(reader: _Reader, device: Device, path: KeyPath, label: str) -> bool:
    """Whether the serial line is fast enough to read the whole map in one polling interval."""
    if device.link.kind is not LinkKind.SERIAL:
        return True
    needed_s = poll_time_s(device.blocks(), device.link)
    if needed_s < device.every_s:
        return True
    found_text = (
        f"{device.every_s:g} s, while one poll occupies the line for at least {needed_s:.2f} s"
    )
    expected = f"more than {needed_s:.2f} s, a higher baudrate, or fewer registers"
    reader.add_problem((*path, "every_s"), f"{label}.every_s", found_text, expected)
    return False


def _described(value: Any) -> str:
    if isinstance(value, str):
        return f"the text {value[:80]!r}" if value else "an empty text"
    if isinstance(value, Mapping):
        return "a table"
    if isinstance(value, list | tuple):
        return f"a list of {len(value)}"
    return str(value).lower() if isinstance(value, bool) else str(value)
