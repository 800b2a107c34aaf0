"""``LayoutInput``: one opened file with what its layout needs to read it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables.document import Document
from stemwatch.connectors.historian.tables.rows import (
    Rows,
    sniff_separator,
    split_rows,
    table_rows,
)

_HEAD = 60
_LINE = 4000
_SAMPLE = 300


@dataclass(frozen=True)
class Body:
    """The rows of data as columns of cells, with the line number of each row."""

    columns: Sequence[Sequence[str]]
    numbers: Sequence[int]


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

    def separator(self) -> str:
        """The user's separator, or the one that divides the lines evenly; a comma where none
        does (a file of one column)."""
        if self.options.separator is not None:
            return self.options.separator
        lines = self.document.lines
        step = max(1, len(lines) // _SAMPLE)
        separator = sniff_separator(lines[:_HEAD] + lines[_HEAD::step])
        if separator is not None:
            separator_name = {"\t": "a tab"}.get(separator, f"{separator!r}")
            self.notes.decide(f"The separator is {separator_name}.")
        return separator or ","

    def rows(self, separator: str, first: int = 0, comment: str = "") -> Rows:
        """All rows from line ``first + 1`` on; lines that begin with ``comment`` are none."""
        lines = self._without_comments(self.document.lines[first:], comment)
        return split_rows(lines, separator, first + 1, self.notes)

    def all_lines(self) -> Sequence[str]:
        """Every line, for a layout that ``rows`` and ``body`` cannot read."""
        return self.document.lines

    def body(
        self,
        rows: Rows,
        first: int,
        width: int,
        separator: str,
        *,
        headers: Sequence[Sequence[str]] = (),
        comment: str = "",
        stops: tuple[str, ...] = (),
    ) -> Body:
        """The rows of data: ``rows`` from index ``first`` on that have ``width`` cells, the others
        reported; without rows that are one of ``headers`` again, which come where files are joined.

        ``separator`` and ``comment`` are those of ``rows``; no line of data begins with any of
        ``stops``.
        """
        data_rows = Rows(rows.cells[first:], rows.numbers[first:])
        data_rows = _without_headers(data_rows, headers, self.notes)
        data_rows = table_rows(data_rows, width, self.notes, ends_whole=self.document.ends_whole)
        columns: list[Sequence[str]] = [
            list(column) for column in zip(*data_rows.cells, strict=True)
        ]
        return Body(columns or [[] for _ in range(width)], data_rows.numbers)

    def compare_with_promised(self, line: int, promised: str, rows: int) -> None:
        """Note a problem where ``line`` of the file says another number of rows than were read."""
        promised = promised.strip()
        if promised.isdecimal() and len(promised) < 19 and int(promised) != rows:
            self.notes.problem(
                f"line {line} promises {promised} rows, {rows} were read; the file may be cut"
            )

    @staticmethod
    def _without_comments(lines: Sequence[str], comment: str) -> Sequence[str]:
        return ["" if line.startswith(comment) else line for line in lines] if comment else lines


def _without_headers(rows: Rows, headers: Sequence[Sequence[str]], notes: ReadingNotes) -> Rows:
    header_rows = {tuple(row) for row in headers}
    starts = {row[0] for row in header_rows}
    data_rows = [
        i
        for i, row in enumerate(rows.cells)
        if row[0].strip() not in starts or tuple(cell.strip() for cell in row) not in header_rows
    ]
    dropped = len(rows.cells) - len(data_rows)
    if not dropped:
        return rows
    notes.decide(f"{dropped} repeated header rows inside the file were left out.")
    return Rows([rows.cells[i] for i in data_rows], [rows.numbers[i] for i in data_rows])


def usual_width(rows: Rows) -> int:
    """The number of cells that most rows have; of two equally common ones the larger."""
    counts = Counter(len(row) for row in rows.cells)
    return max(counts, key=lambda width: (counts[width], width), default=0)
