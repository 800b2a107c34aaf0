"""AVEVA Insight, narrow CSV: ``Operation?,TagName,DateTime,Format?,Value,OpcQuality?``, any order.

UTF-8, ISO 8601 with ``Z`` or offset, decimal point, no thousands marks.
"""

from __future__ import annotations

from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.header_table import read_header_table, required_column
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.narrow import NarrowColumns, narrow_table, pick

_OPTIONAL = {"operation", "format", "opcquality"}


class AvevaInsight:
    """Narrow CSV of AVEVA Insight: header in any order, OPC quality codes."""

    name = "AVEVA Insight"
    order = 45

    def matches(self, head: list[str]) -> bool:
        names = {c.strip().strip('"').lower() for c in head[0].split(",")} if head else set()
        needed = {"tagname", "datetime", "value"}
        return needed <= names <= needed | _OPTIONAL and bool(names & _OPTIONAL)

    def parse(self, source: LayoutInput) -> RawTable:
        table = read_header_table(source, source.rows(","), ",")
        return narrow_table(
            source,
            table.columns,
            table.numbers,
            table.header,
            NarrowColumns(
                tag=required_column(table.header, ("TagName",), source, 1),
                time=(required_column(table.header, ("DateTime",), source, 1),),
                value=required_column(table.header, ("Value",), source, 1),
                quality=pick(table.header, ("OpcQuality",)),
            ),
            separator=",",
            layout="AVEVA Insight narrow CSV",
            family="opc",
            decimal=".",
        )


LAYOUT = AvevaInsight()
