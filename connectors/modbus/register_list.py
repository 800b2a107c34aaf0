"""A register list: the registers of a device as rows of a CSV file beside ``plant.toml``.

The columns are the keys of ``[[devices.registers]]``, with names that other tools use understood
as well; ``raw`` and ``engineering`` are two columns each. A spreadsheet's semicolon and decimal
comma are read.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stemwatch.connectors.modbus.device_tables import TableMistake
from stemwatch.connectors.spreadsheet import ListFault, decoded, is_blank, records_of, separator_of

COLUMNS = (
    "tag", "register", "address", "unit_id", "type", "byte_order", "scale", "offset", "raw_low",
    "raw_high", "engineering_low", "engineering_high", "invalid", "lowest", "highest", "unit",
    "description",
)  # fmt: skip
# What telegraf, Home Assistant and makers of devices call them.
ALIASES = {
    "name": "tag", "input_type": "register", "table": "register", "slave": "unit_id",
    "slave_id": "unit_id", "device_id": "unit_id", "data_type": "type", "datatype": "type",
    "min_value": "lowest", "max_value": "highest", "units": "unit", "engineering_unit": "unit",
}  # fmt: skip
_REQUIRED = ("tag", "address", "type")
_PAIRS = ("raw", "engineering")
_NUMBERS = (
    "scale",
    "offset",
    "lowest",
    "highest",
    *(f"{pair}_{end}" for pair in _PAIRS for end in ("low", "high")),
)
_BETWEEN = "|"  # several invalid values in one cell


class ListUnusable(TableMistake):
    """The list as a whole cannot be read: no file, a heading that is not understood. ``line`` is
    where, ``None`` where there is no line to name; ``key`` is empty where no column is meant."""

    def __init__(self, line: int | None, key: str, found: str, expected: str) -> None:
        super().__init__(key, found, expected)
        self.line = line


@dataclass(frozen=True)
class ListedRow:
    """A row as a ``[[devices.registers]]`` table, and its line in the file."""

    table: Mapping[str, Any]
    line: int


@dataclass(frozen=True)
class RegisterList:
    """The rows of a list; ``faulty`` the lines that are no rows: (line, found, expected)."""

    rows: tuple[ListedRow, ...]
    faulty: tuple[tuple[int, str, str], ...]


def read_register_list(path: Path) -> RegisterList:
    """The rows of the list at ``path``, with numbers where a cell can be read as one. Whether a row
    describes a valid register is checked later (``register_of``).

    Raises ``ListUnusable`` where a mistake concerns every row.
    """
    separator, records = _records(path)
    if not records:
        raise ListUnusable(1, "", "an empty file", "a heading row of " + ", ".join(COLUMNS))
    line, first = records[0]
    heading = _heading(first, line)
    rows: list[ListedRow] = []
    faulty: list[tuple[int, str, str]] = []
    for line, cells in records[1:]:
        if len(cells) < len(heading) or not all(map(is_blank, cells[len(heading) :])):
            faulty.append((line, f"{len(cells)} cells", f"{len(heading)}, as in the heading"))
            continue
        filled_cells = {
            name: cell.strip() for name, cell in zip(heading, cells, strict=False) if cell.strip()
        }
        try:
            rows.append(ListedRow(_table(filled_cells, separator), line))
        except TableMistake as mistake:
            faulty.append((line, f"{mistake.key}: {mistake.found}", mistake.expected))
    return RegisterList(tuple(rows), tuple(faulty))


def _records(path: Path) -> tuple[str, list[tuple[int, list[str]]]]:
    """The separator, and each record that is not blank with the number of its first line."""
    try:
        text = decoded(path.read_bytes())
        separator = separator_of(text)
        return separator, records_of(text, separator)
    except OSError as error:
        expected = "a CSV file of registers, relative to the plant file"
        raise ListUnusable(None, "", error.strerror or str(error), expected) from None
    except ListFault as fault:
        raise ListUnusable(fault.line, "", fault.found, fault.expected) from None


def _heading(cells: Sequence[str], line: int) -> list[str]:
    """The columns. A misread one would be wrong for every register, so the list is refused."""
    written = [cell.strip().lower().replace(" ", "_") for cell in cells]
    while written and not written[-1]:
        written.pop()
    names = [ALIASES.get(name, name) for name in written]
    for name, written_name in zip(names, written, strict=True):
        if name not in COLUMNS:
            close = difflib.get_close_matches(written_name, (*COLUMNS, *ALIASES), n=1, cutoff=0.6)
            hint = f" (did you mean {close[0]!r}?)" if close else ""
            expected = "one of " + ", ".join(COLUMNS) + hint
            raise ListUnusable(line, written_name or "heading", "an unknown column", expected)
        if names.count(name) > 1:
            raise ListUnusable(line, name, f"{names.count(name)} columns of this meaning", "one")
    for name in _REQUIRED:
        if name not in names:
            raise ListUnusable(line, name, "nothing", "a column with this heading")
    return names


def _table(filled_cells: dict[str, str], separator: str) -> dict[str, Any]:
    table: dict[str, Any] = dict(filled_cells)
    for name in _NUMBERS:
        if name in table:
            table[name] = _number(filled_cells[name], separator)
    for pair in _PAIRS:
        ends = [table.pop(f"{pair}_{end}", None) for end in ("low", "high")]
        if ends == [None, None]:
            continue
        if None in ends:
            given_end, missing = ("low", "high") if ends[1] is None else ("high", "low")
            found_text = f"{pair}_{given_end} without {pair}_{missing}"
            raise TableMistake(f"{pair}_{missing}", found_text, "both, or neither")
        table[pair] = ends
    if "unit_id" in table:
        table["unit_id"] = _integer_or_text(filled_cells["unit_id"])
    if "register" in table:
        table["address"] = _integer_or_text(filled_cells.get("address", ""))
    if "invalid" in table:
        cells = [cell.strip() for cell in filled_cells["invalid"].split(_BETWEEN)]
        table["invalid"] = [
            cell if cell.lower() == "nan" else _number(cell, separator) for cell in cells if cell
        ]
    return table


def _integer_or_text(text: str) -> int | str:
    """A whole number, or the text where it is none, such as 0x000B."""
    return int(text) if text.isascii() and text.isdigit() else text


def _number(text: str, separator: str) -> float | int | str:
    """A number, or the text where it is none, which is refused where a number is needed."""
    number_text = text if separator == "," else text.replace(",", ".")
    if (integer := _integer_or_text(number_text)) != number_text:
        return integer
    if number_text[:2].lower() == "0x" or "_" in number_text:
        return text
    try:
        return float(number_text)
    except ValueError:
        return text
