"""Citect / Plant SCADA Process Analyst: the milliseconds are a column of their own."""

from __future__ import annotations

import re

from stemwatch.connectors.historian.layouts.generic import parse_table
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.layout_input import LayoutInput

_HEADER = re.compile(r'^"?(?:Date ?/? ?)?Time"?\s*[,;\t|]\s*"?Milliseconds"?\s*[,;\t|]', re.I)


class Citect:
    """Process Analyst export: the milliseconds stand in a column of their own."""

    name = "Citect Process Analyst"
    order = 35

    def matches(self, head: list[str]) -> bool:
        return any(_HEADER.match(line.strip()) for line in head[:10])

    def parse(self, source: LayoutInput) -> RawTable:
        return parse_table(source, "Citect Process Analyst export (milliseconds apart)")


LAYOUT = Citect()
