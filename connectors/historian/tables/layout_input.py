"""``LayoutInput``: one opened file with what its layout needs to read it."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables.document import Document
from stemwatch.connectors.historian.tables.rows import Rows, sniff_separator, split_rows

_HEAD = 60
_LINE = 4000
_SAMPLE = 300


@dataclass(frozen=True)
class LayoutInput:
    """A document, the user's options, and where to note decisions."""

    document: Document
    options: ReadOptions
    notes: ReadingNotes

    @property
    def name(self) -> str:
        return self.document.name

    @property
    def head(self) -> list[str]:
        """The first lines, for signatures; of a line longer than any header's start, its start."""
        return [line[:_LINE] for line in self.document.lines[:_HEAD]]

    def separator(self, skip: int = 0) -> str:
        """The user's separator, or the one that divides the lines evenly; a comma where none
        does (a file of one column)."""
        if self.options.separator is not None:
            return self.options.separator
        lines = self.document.lines[skip:]
        step = max(1, len(lines) // _SAMPLE)
        separator = sniff_separator(lines[:_HEAD] + lines[_HEAD::step])
        if separator is not None:
            shown = {"\t": "a tab"}.get(separator, f"{separator!r}")
            self.notes.decide(f"The separator is {shown}.")
        return separator or ","

    def rows(self, separator: str, first: int = 0) -> Rows:
        """All rows from line ``first + 1`` on."""
        return split_rows(self.document.lines[first:], separator, first + 1, self.notes)


def usual_width(rows: Rows) -> int:
    """The number of cells that most rows have; of two equally common ones the larger."""
    counts = Counter(len(row) for row in rows.cells)
    return max(counts, key=lambda width: (counts[width], width), default=0)
