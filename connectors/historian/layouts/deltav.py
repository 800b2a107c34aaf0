"""The DeltaV-like wide export: ``MODULE/BLOCK/PARAMETER.FIELD unit`` in every header.

The exporter holds each column's last stored value on a grid of its own, so the columns' real rates
differ; they are measured when the columns are converted.
"""

from __future__ import annotations

import re

from stemwatch.connectors.historian.layouts.generic import parse_table
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.layout_input import LayoutInput

_TAG = re.compile(r"[^,;\t\"/]{1,80}/[^,;\t\"/]{1,80}/[A-Z_0-9]{1,40}\.(?:CV|ACTUAL|ST)\b")


class DeltaV:
    """Wide, one column per `MODULE/BLOCK/PARAMETER.FIELD unit`."""

    name = "DeltaV wide"
    order = 40

    def matches(self, head: list[str]) -> bool:
        return any(len(_TAG.findall(line)) >= 2 for line in head[:5])

    def parse(self, source: LayoutInput) -> RawTable:
        return parse_table(source, "DeltaV-like wide export (unit in the header)")


LAYOUT = DeltaV()
