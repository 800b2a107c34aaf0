"""AspenTech IP.21: ``NAME,IP_TREND_TIME,IP_TREND_VALUE`` and a status or a quality level."""

from __future__ import annotations

from stemwatch.connectors.historian.layouts.generic import parse_table
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.layout_input import LayoutInput


class Ip21:
    """Narrow rows with `IP_TREND_TIME` and `IP_TREND_VALUE`."""

    name = "IP.21"
    order = 55

    def matches(self, head: list[str]) -> bool:
        return any("IP_TREND_TIME" in line.upper() for line in head[:10])

    def parse(self, source: LayoutInput) -> RawTable:
        return parse_table(source, "AspenTech IP.21 history")


LAYOUT = Ip21()
