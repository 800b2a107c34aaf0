"""AVEVA (Wonderware) Historian, rows of the History table.

``DateTime,TagName,Value,vValue,Quality,QualityDetail``; seven fractional digits. ``Quality`` 0 is
good here; ``QualityDetail`` and ``OPCQuality`` are OPC codes, 192 good, and preferred.
"""

from __future__ import annotations

from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.header_table import read_header_table, required_column
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.narrow import NarrowColumns, narrow_table, pick


class AvevaHistory:
    """Narrow rows of the AVEVA (Wonderware) Historian history table; in `Quality` 0 is good."""

    name = "AVEVA history table"
    order = 50

    def matches(self, head: list[str]) -> bool:
        first = head[0].replace('"', "").lower() if head else ""
        names = {cell.strip() for cell in first.replace(";", ",").replace("\t", ",").split(",")}
        telltale_columns = names & {"vvalue", "qualitydetail", "opcquality", "wwretrievalmode"}
        return (
            {"datetime", "tagname", "value"} <= names
            and bool(telltale_columns)
            and "operation" not in names
        )

    def parse(self, source: LayoutInput) -> RawTable:
        separator = source.separator()
        table = read_header_table(source, source.rows(separator), separator)
        detail = pick(table.header, ("QualityDetail", "OPCQuality"))
        quality = pick(table.header, ("Quality",)) if detail is None else detail
        return narrow_table(
            source,
            table.columns,
            table.numbers,
            table.header,
            NarrowColumns(
                tag=required_column(table.header, ("TagName",), source, 1),
                time=(required_column(table.header, ("DateTime",), source, 1),),
                value=required_column(table.header, ("Value",), source, 1),
                quality=quality,
                second_value=pick(table.header, ("vValue",)),
            ),
            separator=separator,
            layout="AVEVA Historian, history table",
            family="opc" if detail is not None else "aveva",
        )


LAYOUT = AvevaHistory()
