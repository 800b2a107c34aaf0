"""In a table of unknown layout: where the header ends, and which columns hold times and numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.tables.layout_input import usual_width
from stemwatch.connectors.historian.tables.rows import Rows
from stemwatch.connectors.historian.times.time_formats import is_clock_only, is_date_only, is_time
from stemwatch.connectors.historian.values.numbers import (
    parse_number,
    parse_numbers,
    quick_numbers,
)
from stemwatch.connectors.historian.values.units import is_unit
from stemwatch.connectors.historian.values.value_texts import text_quality
from stemwatch.models.recording import Quality

_TIME_NAME = re.compile(
    r"^(?:t|ts|time|date|datum|zeit|temps|tiempo|tempo|fecha|uhrzeit|epoch|elapsed|seconds|sekunden"
    r"|날짜|시간|时间|日期|日期时间|zeitstempel|timestamp|t_?stamp|date[_ /]*time"
    r"|ip_trend_time|unix\w*|time_?\w*|t_(?:s|ms|us|ns|min|h)|.*time ?stamp.*|zeit\w*)"
    r"(?:\s*[\[(].*[\])])?$",
    re.I,
)
_LIKE_A_TIME = re.compile(r"[0-9]+([-/.:])[0-9]+\1[0-9]+")  # a date or a time of day
_HEADER_ROWS = 60  # no export has more lines than this before its data
_SAMPLE = 200
_FIRST_CELLS = 5


def is_number(text: str) -> bool:
    """Whether a cell is a number with either decimal mark."""
    return parse_number(text, ".") is not None or parse_number(text, ",") is not None


def is_time_name(header: str) -> bool:
    """Whether a header says by itself that its column holds the time."""
    return _TIME_NAME.match(header.strip()) is not None


@dataclass(frozen=True, kw_only=True)
class Structure:
    """How a table is laid out. Column numbers count from 0."""

    width: int
    first_row: int  # index of the first row of data
    headers: tuple[list[str], ...]  # the header rows, each ``width`` cells
    time: tuple[int, ...]  # one column, two (date and clock), or none
    numeric: tuple[int, ...]  # columns whose cells are mostly numbers
    other_times: tuple[int, ...] = ()  # columns of dates beside ``time``


def find_structure(rows: Rows, options: ReadOptions, name: str) -> Structure:
    """The structure of ``rows``. Raises ``UnreadableSource`` where it is not a table of numbers."""
    width = usual_width(rows)
    full_rows = [i for i, row in enumerate(rows.cells) if len(row) == width]
    if not full_rows:
        raise UnreadableSource(f"{name}: no rows were found; expected a header and rows of data")
    sample = _sample([rows.cells[i] for i in full_rows])
    time: tuple[int, ...] = ()
    if options.time_column is not None:
        time = _time_named(_head(rows, width), options.time_column, name)
    time = (
        time
        or _time_by_content(sample, width)
        or _time_by_header(_head(rows, width), sample)
        or _time_of_day(sample, width)
    )
    first = _first_row(rows, width, time)
    headers = tuple(_fit(row, width) for row in rows.cells[:first] if _is_header(row, width))
    _refuse_turned(rows, name)
    if first == len(rows.cells):
        _refuse_without_data(rows, name)
    numeric = tuple(c for c in range(width) if c not in time and _holds_numbers(sample, c))
    others = [c for c in range(width) if c not in time and c not in numeric]
    return Structure(
        width=width,
        first_row=first,
        headers=headers,
        time=time,
        numeric=numeric,
        other_times=tuple(c for c in others if _holds_times(sample, c)),
    )


def _refuse_turned(rows: Rows, name: str) -> None:
    """Raise where the times stand beside each other in the first line."""
    cells = rows.cells[0][1:]
    if len(cells) > 2 and sum(map(is_time, cells)) > 0.8 * len(cells):
        raise UnreadableSource(
            f"{name}: the times stand beside each other in line {rows.numbers[0]}. Turn the table, "
            "so that each row is a time with the values of all tags"
        )


def _refuse_without_data(rows: Rows, name: str) -> None:
    """Raise for a table in which no row of data was found; a first column may hold times in a form
    that nobody knows."""
    for row in rows.cells[1:_HEADER_ROWS]:
        if _LIKE_A_TIME.search(row[0]) and any(map(is_number, row[1:])):
            raise UnreadableSource(
                f"{name}: {row[0]!r} is no time that can be read; say time_column (--time-column) "
                "and time_format (--time-format), such as '%d.%m.%Y %H:%M:%S'"
            )
    searched = min(_HEADER_ROWS, len(rows.cells))
    where = "its only row" if searched == 1 else f"the first {searched} rows"
    raise UnreadableSource(
        f"{name}: no row of numbers was found in {where}; the first is "
        f"{'|'.join(rows.cells[0])[:60]!r}. Expected a time and values in every row: this is "
        "probably not a recording"
    )


def _head(rows: Rows, width: int) -> list[list[str]]:
    return [_fit(row, width) for row in rows.cells[:_HEADER_ROWS] if _is_header(row, width)]


def _sample(rows: Sequence[list[str]]) -> list[list[str]]:
    """Rows sampled over the whole file, without the first few, which may be headers."""
    body = rows[min(len(rows) // 2, 4) :]
    return [body[i] for i in np.linspace(0, len(body) - 1, min(_SAMPLE, len(body))).astype(int)]


def _share(sample: Sequence[list[str]], column: int, test: object) -> float:
    """Share of the filled cells of ``column`` that pass ``test``."""
    assert callable(test)
    filled = [row[column] for row in sample if row[column].strip()]
    return sum(bool(test(cell)) for cell in filled) / len(filled) if filled else 0.0


def _holds_numbers(sample: Sequence[list[str]], column: int) -> bool:
    # Most of thousands of columns hold only plain numbers, which a quick test recognises.
    cells = [row[column] for row in sample]
    return bool(cells) and (
        quick_numbers(cells, ".") is not None or _share(sample, column, is_number) >= 0.5
    )


def _holds_times(sample: Sequence[list[str]], column: int) -> bool:
    # Most of thousands of columns of words are told by their first cells.
    first = [row[column] for row in sample[:_FIRST_CELLS]]
    return any(map(is_time, first)) and _share(sample, column, is_time) > 0.8


def _time_by_content(sample: Sequence[list[str]], width: int) -> tuple[int, ...]:
    dates: list[int] = []
    for column in range(width):
        if _share(sample, column, is_time) < 0.4:
            continue
        if _share(sample, column, is_date_only) <= 0.8:
            return (column,)
        dates.append(column)
    clocks = [c for c in range(width) if _share(sample, c, is_clock_only) > 0.8]
    if dates and clocks:
        return (dates[0], clocks[0])
    return (dates[0],) if dates else ()


def _time_of_day(sample: Sequence[list[str]], width: int) -> tuple[int, ...]:
    """The first column of times of day, where no column has dates."""
    clocks = (c for c in range(width) if _share(sample, c, is_clock_only) > 0.8)
    return tuple(islice(clocks, 1))


def _time_named(headers: Sequence[list[str]], time_column: str, name: str) -> tuple[int, ...]:
    column = find_header(headers, time_column)
    if column is None:
        shown_cells = ", ".join(repr(cell) for row in headers[:1] for cell in row[:12])
        raise UnreadableSource(
            f"{name}: there is no column {time_column!r} to take the time from; the "
            f"headers are {shown_cells}"
        )
    return (column,)


def find_header(headers: Sequence[list[str]], header: str) -> int | None:
    """Column whose header is ``header``, letters' case aside."""
    for row in headers:
        for column, cell in enumerate(row):
            if cell.strip().lower() == header.strip().lower():
                return column
    return None


def _time_by_header(headers: Sequence[list[str]], sample: Sequence[list[str]]) -> tuple[int, ...]:
    """A numeric column that is called time, or that holds Unix times."""
    for row in headers:
        for column, cell in enumerate(row):
            if is_time_name(cell) and _rises(sample, column):
                return (column,)
    if sample and sample[0]:
        values = parse_numbers([row[0] for row in sample], ".")
        finite = values[np.isfinite(values)]
        if finite.size and _rises(sample, 0) and np.median(finite) > 3e8:
            return (0,)
    return ()


def _rises(sample: Sequence[list[str]], column: int) -> bool:
    """Mostly numbers that rise or mostly fall, as times do even where some are out of order."""
    cells = [row[column] for row in sample]
    values = parse_numbers(cells, ".")
    if np.isfinite(values).mean() < 0.5:
        values = parse_numbers(cells, ",")
    finite = values[np.isfinite(values)]
    if finite.size < 0.8 * len(cells) or finite.size < 2 or finite[-1] == finite[0]:
        return False
    direction = np.sign(finite[-1] - finite[0])
    return bool((np.diff(finite) * direction >= 0).mean() > 0.6)


def _first_row(rows: Rows, width: int, time: tuple[int, ...]) -> int:
    """Index of the first row of data."""
    for index, row in enumerate(rows.cells[:_HEADER_ROWS]):
        if len(row) == width and _is_data(row, time):
            return index
    return len(rows.cells)


def _is_data(row: list[str], time: tuple[int, ...]) -> bool:
    if len(time) == 2:
        return is_date_only(row[time[0]])
    if time:
        # A time in a form of its own is known by its digits only.
        return is_time(row[time[0]]) or (
            any(letter.isdigit() for letter in row[time[0]])
            and any(is_number(cell) for i, cell in enumerate(row) if i != time[0])
        )
    filled = [cell for cell in row if cell.strip()]
    numbers = sum(is_number(cell) for cell in filled)
    words = sum(text_quality(cell) is Quality.MISSING for cell in filled)
    return numbers > 0 and numbers + words >= 0.8 * len(filled)


def _is_header(row: list[str], width: int) -> bool:
    if abs(len(row) - width) > 1:
        return False
    fewest = min(2, width)
    return len(list(islice((cell for cell in row if cell.strip()), fewest))) >= fewest


def _fit(row: list[str], width: int) -> list[str]:
    return [cell.strip() for cell in [*row, ""][:width]]


@dataclass(frozen=True)
class Names:
    """(width,) each: what the header rows say of every column."""

    tags: list[str]
    descriptions: list[str]
    units: list[str]


def column_names(structure: Structure) -> Names:
    """Tags, descriptions and units of the header rows, whichever of them the file has.

    The row of tags is the one whose cells look most like tags: no blanks, all different. A row
    of known unit spellings is the units.
    """
    width, time = structure.width, set(structure.time)
    name_rows = list(structure.headers)
    units = next((row for row in name_rows if _is_unit_row(row, time)), [""] * width)
    name_rows = [row for row in name_rows if row is not units]
    if not name_rows:
        return Names([""] * width, [""] * width, units)
    tags = max(name_rows, key=lambda row: _tag_likeness(row, time))
    others = [row for row in name_rows if row is not tags]
    descriptions = [" ".join(filter(None, cells)) for cells in zip(*others, strict=True)]
    return Names(tags, descriptions or [""] * width, units)


def _is_unit_row(row: list[str], time: set[int]) -> bool:
    cells = [cell for column, cell in enumerate(row) if column not in time and cell]
    unit_count = sum(is_unit(cell) for cell in cells)
    return unit_count > 0 and unit_count >= 0.6 * len(cells)


def _tag_likeness(row: list[str], time: set[int]) -> float:
    cells = [cell for column, cell in enumerate(row) if column not in time and cell]
    if not cells:
        return 0.0
    compact = sum(" " not in cell.strip() for cell in cells) / len(cells)
    return compact + len(set(cells)) / len(cells) + len(cells) / len(row)
