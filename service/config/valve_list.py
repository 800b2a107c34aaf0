"""A valve list: thousands of valves as rows of a CSV file beside ``plant.toml``."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stemwatch.connectors.settings import KeyPath, Problem, either_of, nearest
from stemwatch.connectors.spreadsheet import ListFault, decoded, records_of, separator_of
from stemwatch.models.recording import Role
from stemwatch.service.config.problems import PlantFileError, TableLocation
from stemwatch.service.plant_path import LEVELS

_OF_MONEY = ("target_band", "price_per_unit_hour", "price_per_hour_off_target", "price_per_stroke")
_OF_VALVE = ("id", "description", *LEVELS, "criticality", "source", "stroke", "stroke_curve")
_LIST = "feeds"  # a cell of several names
_FACTS = (*_OF_VALVE, _LIST, *_OF_MONEY)
_NUMBERS = ("low", "high", "deviation")
_TAG_COLUMNS = {
    column: (role.value, key)
    for role in Role
    for column, key in (
        (role.value, "tag"),
        *((f"{role.value}_{key}", key) for key in ("unit", *_NUMBERS)),
    )
}
COLUMNS = (*_FACTS, *_TAG_COLUMNS)
_REQUIRED = ("id", "source", "op")


@dataclass(frozen=True)
class ListedValve:
    """One row as a ``[[valves]]`` table of texts, and its place for messages."""

    table: dict[str, Any]
    location: TableLocation


@dataclass(frozen=True)
class ValveList:
    """The rows of a valve list with the right number of cells, and the problems of the others."""

    rows: tuple[ListedValve, ...]
    problems: tuple[Problem, ...]


def read_valve_list(path: Path, shown_as: str) -> ValveList:
    """Read the list at ``path``, called ``shown_as`` in messages.

    The separator is the comma, semicolon or tab of the heading row; where it is not the comma, a
    number may have a decimal comma, as spreadsheets of many countries write it. Raises
    ``PlantFileError`` when the list as a whole cannot be read: no file, a wrong heading, a
    quotation mark that is never closed.
    """
    text, problems = _text(path, shown_as)
    separator = separator_of(text)
    records = _records(text, separator, shown_as)
    if not records:
        raise _unusable(shown_as, 1, "heading", "an empty file", either_of(COLUMNS))
    heading = _heading(records[0][1])
    _check_heading(heading, records[0][0], shown_as)
    rows: list[ListedValve] = []
    for line, cells in records[1:]:
        location = _row_place(shown_as, line)
        if any(cells[len(heading) :]) or len(cells) < len(heading):
            found_text = f"{len(cells)} cells"
            problems.append(location.problem((), found_text, f"{len(heading)}, as in the heading"))
            continue
        rows.append(
            ListedValve(_table(dict(zip(heading, cells, strict=False)), separator), location)
        )
    return ValveList(tuple(rows), tuple(problems))


def _text(path: Path, shown_as: str) -> tuple[str, list[Problem]]:
    try:
        raw = path.read_bytes()
    except OSError as error:
        found_text = error.strerror or str(error)
        raise _unusable(shown_as, None, "valve_list", found_text, "a CSV file of valves") from None
    try:
        return decoded(raw), []
    except ListFault as fault:
        problem = Problem(
            file=shown_as,
            line=fault.line,
            key="encoding",
            found=fault.found,
            expected="UTF-8 (the list was read as Windows-1252 instead)",
        )
        return raw.decode("cp1252", errors="replace"), [problem]


def _records(text: str, separator: str, shown_as: str) -> list[tuple[int, list[str]]]:
    try:
        return records_of(text, separator)
    except ListFault as fault:
        raise _unusable(shown_as, fault.line, "row", fault.found, fault.expected) from None


def _heading(cells: list[str]) -> list[str]:
    """The column names, without the empty ones that spreadsheets add at the end."""
    names = [cell.strip().lower() for cell in cells]
    while not names[-1]:
        names.pop()
    return names


def _check_heading(heading: list[str], line: int, shown_as: str) -> None:
    """Raise for wrong headings, which would make every valve of the list wrong."""
    location = TableLocation(shown_as, "", lambda _: line, lambda path: f"column {path[0]}")
    unknown = [name for name in heading if name not in COLUMNS]
    problems = [
        location.problem((name,), "an unknown column", either_of(COLUMNS) + nearest(name, COLUMNS))
        for name in unknown
    ]
    problems += [
        location.problem((name,), "nothing", "a column with this heading")
        for name in _REQUIRED
        if name not in heading
    ]
    problems += [
        location.problem((name,), f"{heading.count(name)} columns with this heading", "one")
        for name in dict.fromkeys(heading)
        if name in COLUMNS and heading.count(name) > 1
    ]
    if problems:
        raise PlantFileError(problems)


def _table(cells: dict[str, str], separator: str) -> dict[str, Any]:
    """The row as a table; empty cells are left out."""
    table: dict[str, Any] = {"tags": {}}
    for column, cell in cells.items():
        text = cell.strip()
        if not text:
            continue
        if column in _OF_MONEY and separator != ",":
            text = text.replace(",", ".")
        if column == _LIST:
            table[column] = [name for part in re.split("[|,;]", text) if (name := part.strip())]
            continue
        if column in _FACTS:
            table[column] = text
            continue
        role, key = _TAG_COLUMNS[column]
        if key in _NUMBERS and separator != ",":
            text = text.replace(",", ".")
        table["tags"].setdefault(role, {})[key] = text
    return table


def _row_place(shown_as: str, line: int) -> TableLocation:
    return TableLocation(shown_as, "", lambda _: line, _column)


def _column(path: KeyPath) -> str:
    """The column of a path inside a valve's table: ``("tags", "op", "low")`` is ``op_low``."""
    if not path:
        return "row"
    if path[0] != "tags":
        return f"column {path[0]}"
    role = path[1] if len(path) > 1 else Role.OP.value
    key = path[2] if len(path) > 2 else "tag"
    return f"column {role}" if key == "tag" else f"column {role}_{key}"


def _unusable(
    shown_as: str, line: int | None, key: str, found: str, expected: str
) -> PlantFileError:
    problem = Problem(file=shown_as, line=line, key=key, found=found, expected=expected)
    return PlantFileError([problem])
