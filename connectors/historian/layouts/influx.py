"""InfluxDB annotated CSV: ``#datatype``, ``#group``, ``#default``, then tables under headers.

The first column is empty. Several tables in one file repeat annotations and header. A tag is the
measurement, the other group tags and the field.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.narrow import NarrowColumns, narrow_table
from stemwatch.connectors.historian.tables.rows import Rows
from stemwatch.connectors.historian.values.stored_text import make_of_rows

_OWN = frozenset(
    ("", "result", "table", "_start", "_stop", "_time", "_value", "_field", "_measurement")
)
_NAMING = ("_measurement", "_field")


class Influx:
    """Annotated CSV: several tables in one file, each under its own annotations."""

    name = "InfluxDB annotated CSV"
    order = 25

    def matches(self, head: list[str]) -> bool:
        return any(line.startswith(("#group,", "#datatype,", "#default,")) for line in head[:4])

    def parse(self, source: LayoutInput) -> RawTable:
        rows = source.rows(",")
        is_annotation = [row[0].startswith("#") for row in rows.cells]
        first = is_annotation.index(False) if False in is_annotation else len(is_annotation)
        if any(is_annotation[first:]):
            return self._tables(source, rows)
        if first == len(is_annotation):
            raise UnreadableSource(
                f"{source.name}: expected a header with _time and _value after the lines with #"
            )
        header = self._header(source, rows.cells[first], rows.numbers[first])
        body = source.body(rows, first + 1, len(header), ",", stops=("#",))
        columns = dict(zip(header, body.columns, strict=True))
        naming = [name for name in columns if name in _NAMING or name not in _OWN]
        tags = make_of_rows(
            [columns[name] for name in naming],
            lambda cells: _tag(dict(zip(naming, cells, strict=True))),
        )
        return self._narrow(source, (tags, columns["_time"], columns["_value"]), body.numbers)

    def _tables(self, source: LayoutInput, rows: Rows) -> RawTable:
        """Several tables, each under its own annotations and header."""
        source.all_lines()  # rows of a part of the file would not do
        tags: list[str] = []
        times: list[str] = []
        values: list[str] = []
        numbers: list[int] = []
        header: list[str] = []
        for row, number in zip(rows.cells, rows.numbers, strict=True):
            if row[0].startswith("#"):
                header = []
            elif not header:
                header = self._header(source, row, number)
            elif len(row) != len(header):
                source.notes.problem(
                    f"line {number}: {len(row)} cells where {len(header)} were expected; left out"
                )
            else:
                cells = dict(zip(header, row, strict=True))
                tags.append(_tag(cells))
                times.append(cells["_time"])
                values.append(cells["_value"])
                numbers.append(number)
        return self._narrow(source, (tags, times, values), numbers)

    def _narrow(
        self, source: LayoutInput, columns: Sequence[Sequence[str]], numbers: Sequence[int]
    ) -> RawTable:
        return narrow_table(
            source,
            columns,
            numbers,
            ("tag", "_time", "_value"),
            NarrowColumns(tag=0, time=(1,), value=2),
            separator=",",
            layout="InfluxDB annotated CSV",
            decimal=".",
        )

    def _header(self, source: LayoutInput, row: list[str], number: int) -> list[str]:
        header = [cell.strip() for cell in row]
        if not {"_time", "_value"} <= set(header):
            raise UnreadableSource(
                f"{source.name}: line {number}: expected the columns _time and _value; found "
                f"{', '.join(filter(None, header))}. A pivoted result cannot be read here"
            )
        return header


def _tag(cells: Mapping[str, str]) -> str:
    others = [value for name, value in cells.items() if name not in _OWN and value]
    parts = [cells.get("_measurement", ""), *others, cells.get("_field", "")]
    return "/".join(part for part in parts if part) or "_value"


LAYOUT = Influx()
