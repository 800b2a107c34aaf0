"""A wide table: one time column, one column per tag, status columns beside them; or time, value,
time, value, where tags have time columns of their own."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.connectors.historian.raw_table import Index, RawColumn, RawTable, RawTimes
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables.layout_input import Body, LayoutInput
from stemwatch.connectors.historian.tables.structure import (
    Names,
    Structure,
    column_names,
    is_time_name,
)
from stemwatch.connectors.historian.tables.text_pieces import NotInPieces
from stemwatch.connectors.historian.values.numbers import parse_numbers
from stemwatch.connectors.historian.values.quality_codes import looks_like_codes
from stemwatch.connectors.historian.values.stored_text import StoredText, joined
from stemwatch.connectors.historian.values.units import bare_tag, canonical, split_unit
from stemwatch.connectors.settings import LONGEST_S, SHORTEST_S

_ROW_NUMBER = frozenset(("", "index", "row", "no", "no.", "nr", "nr.", "#", "unnamed: 0", "record"))
_INTERVAL_NAME = re.compile(
    r"(?:ts|dt|t_?s(?:ample)?|interval|sampl(?:e|ing)[ _]?(?:time|interval|period))"
    r"(?:_(?:s|ms|min)|\s*[\[(](?:s|sec|ms|min)[\])])?$",
    re.I,
)
_INTERVAL_UNIT_S = {"ms": 1e-3, "min": 60.0}
_LOOKED_AT = 20_000  # rows of a large file checked for a column with the same value in each
_STATUS = ("status", "quality", "qualität", "qualitaet", "qual", "qstatus", "opcquality", "state")
_NUMBERED = re.compile(r"[ ._]?\(?[0-9]+\)?$")  # the second of two equal headings: Time.1


@dataclass(frozen=True, kw_only=True)
class _TimedColumns:
    """A time column with the columns that it times, as numbers of columns."""

    time: int
    values: tuple[int, ...]


def wide_table(
    source: LayoutInput, body: Body, structure: Structure, separator: str, layout: str
) -> RawTable:
    """The table of a file whose rows of data are ``body``."""
    names = column_names(structure)
    groups = () if source.options.time_column else _timed_columns(structure, names)
    if groups:
        return _timed_apart(source, body, names, groups, separator)
    times, used = _times(body, structure, names, source)
    interval_s, interval_name, skipped = _interval_column(body, names, used)
    used |= skipped | _row_numbers(body, names, used, source.notes)
    columns = _columns(body, names, used)
    return RawTable(
        layout=layout,
        times=times,
        columns=unique_tags(columns, source.notes),
        numbers=body.numbers,
        separator=separator,
        interval_s=interval_s,
        interval_name=interval_name,
    )


def _timed_apart(
    source: LayoutInput,
    body: Body,
    names: Names,
    groups: Sequence[_TimedColumns],
    separator: str,
) -> RawTable:
    """The table of a file whose tags have times of their own."""
    if isinstance(body.columns[0], StoredText):
        raise NotInPieces
    names = _names_beside_times(names, groups)
    parts = _rows_of_groups(body, groups)
    columns: list[RawColumn] = []
    for group, part in zip(groups, parts, strict=True):
        others = set(range(len(names.tags))) - set(group.values)
        columns += [replace(c, rows=part.rows) for c in _columns(part.body, names, others)]
    source.notes.decide(
        f"There are {len(groups)} time columns; each tag has the times of the one to its left."
    )
    texts = [text for g, p in zip(groups, parts, strict=True) for text in p.body.columns[g.time]]
    return RawTable(
        layout="wide table: tags with time columns of their own",
        times=RawTimes(texts=texts, name=names.tags[groups[0].time]),
        columns=unique_tags(columns, source.notes),
        numbers=[number for part in parts for number in part.body.numbers],
        separator=separator,
        narrow=True,
    )


def _timed_columns(structure: Structure, names: Names) -> tuple[_TimedColumns, ...]:
    """The columns by their time column, the nearest to the left; none where one column times the
    whole table, where a time column has no value beside it, as a second stamp of each row, or where
    its heading says that it is something else."""
    times = sorted({*structure.time, *structure.other_times})
    if len(structure.time) != 1 or len(times) < 2 or times[0] != structure.time[0]:
        return ()
    ends = [*times[1:], structure.width]
    groups = tuple(
        _TimedColumns(time=time, values=tuple(range(time + 1, end)))
        for time, end in zip(times, ends, strict=True)
    )
    are_pairs = all(group.values and _heads_a_time(group, names) for group in groups)
    return groups if are_pairs else ()


def _heads_a_time(group: _TimedColumns, names: Names) -> bool:
    heading = _NUMBERED.sub("", names.tags[group.time])
    return is_time_name(heading) or not names.tags[group.values[0]]


def _names_beside_times(names: Names, groups: Sequence[_TimedColumns]) -> Names:
    """``names``, where a heading stands over the time of a tag and not over its value."""
    tags = list(names.tags)
    for group in groups:
        over_time, first = tags[group.time], group.values[0]
        if not tags[first] and over_time and not is_time_name(over_time):
            tags[first] = over_time
    return replace(names, tags=tags)


@dataclass(frozen=True, kw_only=True)
class _RowsOfGroup:
    """The rows of ``body`` that have a time of the group, and their places among all such rows."""

    body: Body
    rows: Index


def _rows_of_groups(body: Body, groups: Sequence[_TimedColumns]) -> list[_RowsOfGroup]:
    """The rows of each group in turn: below each other they are the rows of the table."""
    parts, begin = [], 0
    for group in groups:
        kept = [row for row, text in enumerate(body.columns[group.time]) if text.strip()]
        columns = [[cells[row] for row in kept] for cells in body.columns]
        part = Body(columns, [body.numbers[row] for row in kept])
        parts.append(_RowsOfGroup(body=part, rows=np.arange(begin, begin + len(kept))))
        begin += len(kept)
    return parts


def _times(
    body: Body, structure: Structure, names: Names, source: LayoutInput
) -> tuple[RawTimes, set[int]]:
    if not structure.time:
        return RawTimes(texts=None), set()
    used = set(structure.time)
    header = names.tags[structure.time[0]]
    texts = body.columns[structure.time[0]]
    if len(structure.time) == 2:
        source.notes.decide("Date and time of day are two columns; they were joined.")
        texts = joined(texts, body.columns[structure.time[1]])
    if not source.options.time_column and header:
        source.notes.decide(f"The time is column {header!r}.")
    milliseconds = None
    for column, tag in enumerate(names.tags):
        if column not in used and tag.lower() in ("milliseconds", "millisecond", "msec"):
            milliseconds = body.columns[column]
            used.add(column)
    return RawTimes(texts=texts, name=header, milliseconds=milliseconds), used


def _interval_column(
    body: Body, names: Names, used: set[int]
) -> tuple[float | None, str, set[int]]:
    """A column such as ``Ts`` with one number in its first row, or the same in every row, tells
    the interval: seconds, header, column."""
    for column, tag in enumerate(names.tags):
        if column in used or not _INTERVAL_NAME.match(tag.strip()):
            continue
        cells = body.columns[column]
        first_cells = cells.first(_LOOKED_AT) if isinstance(cells, StoredText) else cells
        filled = [cell for cell in first_cells if cell.strip()]
        values = parse_numbers(filled, "," if any("," in cell for cell in filled) else ".")
        scale = _INTERVAL_UNIT_S.get(_interval_unit(tag, names.units[column]), 1.0)
        if not values.size or not np.isfinite(values).all():
            continue
        if not SHORTEST_S <= values[0] * scale <= LONGEST_S:
            continue
        if values.size == 1 or (
            values.size == len(first_cells) and bool((values == values[0]).all())
        ):
            return float(values[0]) * scale, tag, {column}
    return None, "", set()


def _interval_unit(tag: str, unit: str) -> str:
    """``ms`` of ``Ts [ms]``, ``ts_ms`` or a row of units; empty where none is said."""
    match = re.search(r"(?:_|\[|\(|\s)(ms|min)\s*[\])]?$", tag.strip(), re.I)
    return match[1].lower() if match else unit.strip().strip("[]()").lower()


def _row_numbers(body: Body, names: Names, used: set[int], notes: ReadingNotes) -> set[int]:
    """The first column where it only counts the rows."""
    if 0 in used or not body.columns or names.tags[0].lower() not in _ROW_NUMBER:
        return set()
    values = parse_numbers(body.columns[0], ".")
    if not used or not np.isfinite(values).all() or values.size < 2:
        return set()
    if (np.diff(values) == 1.0).mean() < 0.9:
        return set()
    notes.decide("The first column only numbers the rows; it was left out.")
    return {0}


def _columns(body: Body, names: Names, used: set[int]) -> list[RawColumn]:
    columns: list[RawColumn] = []
    for i, cells in enumerate(body.columns):
        header = names.tags[i]
        if i in used or not (header or any(cell.strip() for cell in cells)):
            continue
        owner = _status_owner(header, cells, columns)
        if owner is not None:
            columns[owner] = replace(columns[owner], quality_codes=cells, quality_name=header)
            continue
        unit = canonical(names.units[i]) or split_unit(header)[1]
        columns.append(
            RawColumn(
                tag=bare_tag(header) or f"column {i + 1}",
                cells=cells,
                unit=unit,
                description=names.descriptions[i],
            )
        )
    return columns


def _status_owner(header: str, cells: Sequence[str], columns: list[RawColumn]) -> int | None:
    """Index of the tag whose quality this column tells, or ``None`` for a tag of its own."""
    lower = header.lower()
    word = next((w for w in _STATUS if lower.endswith(w)), None)
    if word is None or not columns or not looks_like_codes(cells):
        return None
    base = lower.removesuffix(word).rstrip(" ._-/:([")
    for index in range(len(columns) - 1, -1, -1):
        if base and columns[index].tag.lower() == base:
            return index
    return len(columns) - 1 if not base and columns[-1].quality_codes is None else None


def unique_tags(columns: list[RawColumn], notes: ReadingNotes) -> list[RawColumn]:
    """Tags that occur twice get a number, so that none hides the other."""
    seen: dict[str, int] = {}
    out: list[RawColumn] = []
    used_tags = {column.tag for column in columns}
    for column in columns:
        seen[column.tag] = seen.get(column.tag, 0) + 1
        tag = column.tag
        if seen[column.tag] > 1:
            count = seen[column.tag]
            while (tag := f"{column.tag} ({count})") in used_tags:
                count += 1
            used_tags.add(tag)
            notes.decide(f"The tag {column.tag!r} heads more than one column; one is {tag!r} here.")
        out.append(replace(column, tag=tag))
    return out
