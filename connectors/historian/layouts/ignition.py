"""Ignition: ``#NAMES``, ``#TYPES``, ``#ROWS`` and the rows, or the plain form with ``t_stamp``."""

from __future__ import annotations

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.layouts.generic import parse_table
from stemwatch.connectors.historian.raw_table import RawColumn, RawTable, RawTimes
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.rows import split_rows
from stemwatch.connectors.historian.tables.wide import unique_tags


class Ignition:
    """Lines `#NAMES`, `#TYPES`, `#ROWS`, or a plain table that begins with `t_stamp`."""

    name = "Ignition"
    order = 30

    def matches(self, head: list[str]) -> bool:
        first = next((line.strip().strip('"') for line in head if line.strip()), "")
        return first.startswith("#NAMES") or first.lower().startswith(("t_stamp,", 't_stamp",'))

    def parse(self, source: LayoutInput) -> RawTable:
        if not source.head[0].strip().strip('"').startswith("#NAMES"):
            return parse_table(source, "Ignition, plain CSV")
        lines = source.document.lines
        header = split_rows(lines[1:2], ",", 2, source.notes).cells
        marks = [i for i, line in enumerate(lines[:8]) if line.strip('"').startswith("#ROWS")]
        if not header or not marks:
            raise UnreadableSource(
                f"{source.name}: expected the tags in line 2 and a line '#ROWS,n' before the data"
            )
        return self._rows(source, header[0], marks[0])

    def _rows(self, source: LayoutInput, names: list[str], mark: int) -> RawTable:
        body = source.body(source.rows(",", mark + 1), 0, len(names), ",")
        cells = body.columns
        time = next((i for i, n in enumerate(names) if n.strip().lower() == "t_stamp"), 0)
        columns = [
            RawColumn(tag=names[i].strip(), cells=cells[i]) for i in range(len(names)) if i != time
        ]
        promised = source.document.lines[mark].strip('"').partition(",")[2].strip(' "')
        source.compare_with_promised(mark + 1, promised, len(body.numbers))
        return RawTable(
            layout="Ignition CSV with #NAMES",
            times=RawTimes(texts=cells[time], name=names[time]),
            columns=unique_tags(columns, source.notes),
            numbers=body.numbers,
            separator=",",
        )


LAYOUT = Ignition()
