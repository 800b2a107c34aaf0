"""GE Proficy Historian: the CSV with ``[Data]`` sections and the extract without header.

CSV: ``*`` begins a comment; the order of values follows the header line of the section; short
dates are American. Extract: ``epoch:nanoseconds,tag,value,type,GOOD|BAD``.
"""

from __future__ import annotations

import re

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.header_table import (
    HeaderTable,
    read_header_table,
    required_column,
)
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.narrow import (
    QUALITY_NAMES,
    TAG_NAMES,
    VALUE_NAMES,
    NarrowColumns,
    narrow_table,
    pick,
)
from stemwatch.connectors.historian.tables.rows import Rows, split_rows
from stemwatch.connectors.historian.values.stored_text import change_each

_SECTION = re.compile(r"^\[(Tags|Data|Messages|Alarms)\]\s*$", re.I)
_EXTRACT = re.compile(r"^\d{9,10}:\d{1,9},[^,]+,[^,]*,\w+,(?:GOOD|BAD)\s*$", re.I)
_EXTRACT_HEADER = ["time", "tag", "value", "type", "quality"]
_TIMES = ("timestamp", "time stamp", "time", "datetime", "date")


class ProficyCsv:
    """Sections in brackets; the samples stand under `[Data]`."""

    name = "Proficy [Data]"
    order = 20

    def matches(self, head: list[str]) -> bool:
        first = next((line for line in head if line.strip() and not line.startswith("*")), "")
        return (
            _SECTION.match(first.strip()) is not None or _EXTRACT.match(first.strip()) is not None
        )

    def parse(self, source: LayoutInput) -> RawTable:
        lines = source.document.lines
        sections = [i for i, line in enumerate(lines) if _SECTION.match(line.strip())]
        if not sections:
            return self._extract(source)
        data = [i for i in sections if "data" in lines[i].lower()]
        if not data:
            raise UnreadableSource(
                f"{source.name}: line {sections[0] + 1}: no [Data] section; the file has "
                f"{', '.join(lines[i].strip() for i in sections)}. Export the data of the tags"
            )
        if len(sections) > 1:
            return self._sections(source)
        rows = source.rows(",", data[0] + 1, comment="*")
        table = read_header_table(source, rows, ",", comment="*", stops=("[",))
        return self._table(source, table, data[0] + 2)

    def _sections(self, source: LayoutInput) -> RawTable:
        """All ``[Data]`` sections, whose header lines must be the same."""
        lines = source.all_lines()
        sections = [i for i, line in enumerate(lines) if _SECTION.match(line.strip())]
        data = [i for i in sections if "data" in lines[i].lower()]
        cells: list[list[str]] = []
        numbers: list[int] = []
        header: list[str] = []
        for begin in data:
            end = min((i for i in sections if i > begin), default=len(lines))
            part = self._part(source, begin + 1, end)
            if not part.cells:
                continue
            header = header or [cell.strip() for cell in part.cells[0]]
            cells += part.cells[1:]
            numbers += part.numbers[1:]
        table = read_header_table(source, Rows([header, *cells], [data[0] + 2, *numbers]), ",")
        return self._table(source, table, data[0] + 2)

    def _table(self, source: LayoutInput, table: HeaderTable, line: int) -> RawTable:
        return narrow_table(
            source,
            table.columns,
            table.numbers,
            table.header,
            self._narrow_columns(source, table.header, line),
            separator=",",
            layout="Proficy Historian CSV, section [Data]",
            day_first=False,
        )

    def _part(self, source: LayoutInput, begin: int, end: int) -> Rows:
        lines = ["" if ln.startswith("*") else ln for ln in source.document.lines[begin:end]]
        return split_rows(lines, ",", begin + 1, source.notes)

    def _narrow_columns(self, source: LayoutInput, header: list[str], line: int) -> NarrowColumns:
        return NarrowColumns(
            tag=required_column(header, TAG_NAMES, source, line),
            time=(required_column(header, _TIMES, source, line),),
            value=required_column(header, VALUE_NAMES, source, line),
            quality=pick(header, QUALITY_NAMES),
        )

    def _extract(self, source: LayoutInput) -> RawTable:
        body = source.body(source.rows(","), 0, len(_EXTRACT_HEADER), ",")
        return narrow_table(
            source,
            (change_each(body.columns[0], _epoch), *body.columns[1:]),
            body.numbers,
            _EXTRACT_HEADER,
            NarrowColumns(tag=1, time=(0,), value=2, quality=4),
            separator=",",
            layout="Proficy Historian extract",
            decimal=".",
        )


def _epoch(text: str) -> str:
    seconds, colon, nanoseconds = text.strip().partition(":")
    return f"{seconds}{nanoseconds.zfill(9)}" if colon and len(nanoseconds) <= 9 else ""


LAYOUT = ProficyCsv()
