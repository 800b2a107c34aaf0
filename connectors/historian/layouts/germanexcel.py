"""German Excel: semicolons, decimal commas, day first, ``Zeitstempel`` at the head of the times."""

from __future__ import annotations

import re

from stemwatch.connectors.historian.layouts.generic import parse_table
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.layout_input import LayoutInput

_HEADER = re.compile(r'^"?(?:Zeitstempel|Zeit|Datum|Uhrzeit)\b[^;]*"?;', re.I)


class GermanExcel:
    """Semicolons, decimal commas, day first."""

    name = "German Excel"
    order = 800

    def matches(self, head: list[str]) -> bool:
        return any(_HEADER.match(line.strip()) for line in head[:20])

    def parse(self, source: LayoutInput) -> RawTable:
        return parse_table(source, "German Excel (semicolon, decimal comma, day first)")


LAYOUT = GermanExcel()
