"""PI DataLink sheets saved as CSV: tags across, any cell may hold a message, headers may return.

Recognised by PI's own messages or by up to three header rows over Korean times; then read as any
wide table.
"""

from __future__ import annotations

import re

from stemwatch.connectors.historian.layouts.generic import parse_table
from stemwatch.connectors.historian.raw_table import RawTable
from stemwatch.connectors.historian.tables.layout_input import LayoutInput

_SIGNS = re.compile(
    r"오전|오후|\[-110\d\d\]|No Good Data For Calculation|Resize to show all values|"
    r"I/O Timeout|Not Enough Values For Calculation"
)


class DataLink:
    """A PI DataLink sheet saved as CSV: wide, with messages in the place of values."""

    name = "PI DataLink"
    order = 900

    def matches(self, head: list[str]) -> bool:
        return any(_SIGNS.search(line) for line in head)

    def parse(self, source: LayoutInput) -> RawTable:
        return parse_table(source, "PI DataLink sheet")


LAYOUT = DataLink()
