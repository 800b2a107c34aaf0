"""A table whose first line is its header and whose columns are known by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.narrow import pick
from stemwatch.connectors.historian.tables.rows import Rows


@dataclass(frozen=True)
class HeaderTable:
    """Columns of cells under their names, with the line number of each row."""

    header: list[str]
    columns: Sequence[Sequence[str]]
    numbers: Sequence[int]


def read_header_table(
    source: LayoutInput,
    rows: Rows,
    separator: str,
    *,
    comment: str = "",
    stops: tuple[str, ...] = (),
) -> HeaderTable:
    """``rows`` with the first as header; rows of another width are reported and left out."""
    header = [cell.strip() for cell in rows.cells[0]] if rows.cells else []
    body = source.body(rows, 1, len(header), separator, comment=comment, stops=stops)
    return HeaderTable(header, body.columns, body.numbers)


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
