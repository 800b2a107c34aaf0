"""A wide table in which tags have time columns of their own: time, value, time, value."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.connectors.historian.tables.layout_input import Body
from stemwatch.connectors.historian.tables.raw_table import Index
from stemwatch.connectors.historian.tables.structure import Names, Structure, is_time_name

_NUMBERED = re.compile(r"[ ._]?\(?[0-9]+\)?$")  # the second of two equal headings: Time.1


@dataclass(frozen=True, kw_only=True)
class TimedColumns:
    """A time column with the columns that it times, as numbers of columns."""

    time: int
    values: tuple[int, ...]


def timed_columns(structure: Structure, names: Names) -> tuple[TimedColumns, ...]:
    """The columns by their time column, the nearest to the left; none where one column times the
    whole table, where a time column has no value beside it, as a second stamp of each row, or where
    its heading says that it is something else."""
    times = sorted({*structure.time, *structure.other_times})
    if len(structure.time) != 1 or len(times) < 2 or times[0] != structure.time[0]:
        return ()
    ends = [*times[1:], structure.width]
    groups = tuple(
        TimedColumns(time=time, values=tuple(range(time + 1, end)))
        for time, end in zip(times, ends, strict=True)
    )
    are_pairs = all(group.values and _heads_a_time(group, names) for group in groups)
    return groups if are_pairs else ()


def _heads_a_time(group: TimedColumns, names: Names) -> bool:
    heading = _NUMBERED.sub("", names.tags[group.time])
    return is_time_name(heading) or not names.tags[group.values[0]]


def names_beside_times(names: Names, groups: Sequence[TimedColumns]) -> Names:
    """``names``, where a heading stands over the time of a tag and not over its value."""
    tags = list(names.tags)
    for group in groups:
        over_time, first = tags[group.time], group.values[0]
        if not tags[first] and over_time and not is_time_name(over_time):
            tags[first] = over_time
    return replace(names, tags=tags)


@dataclass(frozen=True, kw_only=True)
class RowsOfGroup:
    """The rows of ``body`` that have a time of the group, and their places among all such rows."""

    body: Body
    rows: Index


def rows_of_groups(body: Body, groups: Sequence[TimedColumns]) -> list[RowsOfGroup]:
    """The rows of each group in turn: below each other they are the rows of the table."""
    parts, begin = [], 0
    for group in groups:
        kept = [row for row, text in enumerate(body.columns[group.time]) if text.strip()]
        columns = [[cells[row] for row in kept] for cells in body.columns]
        part = Body(columns, [body.numbers[row] for row in kept])
        parts.append(RowsOfGroup(body=part, rows=np.arange(begin, begin + len(kept))))
        begin += len(kept)
    return parts
