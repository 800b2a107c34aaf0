"""A table whose first line is its header and whose columns are known by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.narrow import pick
from stemwatch.connectors.historian.tables.rows import Rows, table_rows


@dataclass(frozen=True)
class HeaderTable:
    """Columns of cells under their names, with the line number of each row."""

    header: list[str]
    columns: list[Sequence[str]]
    numbers: list[int]


def read_header_table(source: LayoutInput, rows: Rows) -> HeaderTable:
    """``rows`` with the first as header; rows of another width are reported and left out."""
    header = [cell.strip() for cell in rows.cells[0]] if rows.cells else []
    body = table_rows(
        Rows(rows.cells[1:], rows.numbers[1:]),
        len(header),
        source.notes,
        ends_whole=source.document.ends_whole,
    )
    columns: list[Sequence[str]] = list(zip(*body.cells, strict=True))
    return HeaderTable(header, columns or [[] for _ in header], body.numbers)


def required_column(
    header: Sequence[str], names: Sequence[str], source: LayoutInput, line: int
) -> int:
    """The column with one of ``names``. Raises ``UnreadableSource`` where there is none."""
    column = pick(header, names)
    if column is None:
        raise UnreadableSource(
            f"{source.name}: line {line}: expected a column {' or '.join(names[:3])}; found "
            f"{', '.join(header) or 'nothing'}"
        )
    return column
