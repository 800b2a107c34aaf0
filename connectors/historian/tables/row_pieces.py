"""The rows of a large table in blocks: quotes taken off, rows that do not count left out.

A block holds rows of one width, one a line. Cells are apart by the separator, in a file with
quotes by ``MARK``; a line end inside a quoted cell is ``BREAK``. Neither sign stands in text that
is read in pieces. What is a row, and what is said of one that is left out, is what ``rows`` says of
the same lines.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import overload

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables.rows import row_left_out, whole_rows
from stemwatch.connectors.historian.tables.text_pieces import NotInPieces, TextPieces, lines_in

MARK, BREAK = "\x1f", "\x1e"
_MARK = MARK.encode()
# With more rows of another width than this number and this share of all rows, the layout was not
# recognised rightly.
_MOST_LEFT_OUT, _SHARE_LEFT_OUT = 1000, 0.01


class LineNumbers(Sequence[int]):
    """The number of the line on which each row begins, kept as runs of neighbouring lines."""

    def __init__(self) -> None:
        self._rows, self._ahead = array("q"), array("q")  # of each run: first row; line - row
        self._size = 0

    def extend(self, first: int, count: int) -> None:
        """So many rows on the lines from ``first`` on."""
        if count and (not self._rows or self._ahead[-1] != first - self._size):
            self._rows.append(self._size)
            self._ahead.append(first - self._size)
        self._size += count

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, index: int) -> int: ...
    @overload
    def __getitem__(self, at: slice) -> list[int]: ...
    def __getitem__(self, at: int | slice) -> int | list[int]:
        if isinstance(at, slice):
            return [self[row] for row in range(*at.indices(self._size))]
        row = at + self._size if at < 0 else at
        if not 0 <= row < self._size:
            raise IndexError(at)
        return row + self._ahead[bisect_right(self._rows, row) - 1]


@dataclass(kw_only=True)
class RowPieces:
    """The rows of data of one table, as often as they are asked for.

    ``headers`` are rows that may come back and are left out; lines that begin with ``comment`` are
    no rows, and one that begins with any of ``stops`` makes it a file to be read whole.
    """

    text: TextPieces
    separator: str
    width: int
    first_line: int
    headers: Sequence[Sequence[str]] = ()
    comment: str = ""
    stops: tuple[str, ...] = ()
    numbers: LineNumbers = field(default_factory=LineNumbers)
    has_comma: bool = False  # in a cell
    has_point: bool = False
    has_break: bool = False
    longest: int = 0  # bytes of a row as it is stored, at most
    header_rows: int = 0  # that came back
    has_quotes: bool = False
    _left_out: int = 0
    _as_it_is: set[int] = field(default_factory=set)  # blocks in which nothing is to be changed
    _plain_quotes: bool = True  # each is at an end of a cell, and no cell has a line end
    _dropped_only: bool = True  # nothing else than rows of another width was changed

    @property
    def as_stored(self) -> bool:
        """Whether the file's own lines are the rows, those of another width and the quotes around
        cells aside."""
        unchanged_from = self.text.as_stored_from
        if unchanged_from is None or self.first_line < unchanged_from:
            return False
        return self._dropped_only and self._plain_quotes

    @property
    def mark(self) -> str:
        """What stands between the cells of ``blocks``."""
        return MARK if self.has_quotes else self.separator

    def look_through(self, notes: ReadingNotes) -> None:
        """Find out what ``blocks`` needs. Raises ``NotInPieces``."""
        if len(self.separator.encode()) != 1 or self.width < 2:
            raise NotInPieces
        if any(line.count('"') % 2 for line in self.text.head[: self.first_line - 1]):
            raise NotInPieces  # their problems are reported by the reader of the whole file
        quotes, widths = ReadingNotes(), ReadingNotes()
        for block, mark in self._blocks(_Sampler(quotes, widths)):
            self.has_comma = self.has_comma or (mark != b"," and b"," in block)
            self.has_point = self.has_point or b"." in block
            self.has_break = self.has_break or BREAK.encode() in block
        if self._left_out > max(_MOST_LEFT_OUT, _SHARE_LEFT_OUT * len(self.numbers)):
            raise NotInPieces
        notes.take(quotes)
        if self.header_rows:
            notes.decide(f"{self.header_rows} repeated header rows inside the file were left out.")
        notes.take(widths)

    def blocks(self) -> Iterator[bytes]:
        """The rows, ``mark`` between their cells; the same at every call."""
        separator, wanted = self.separator.encode(), self.mark.encode()
        for block, mark in self._blocks(None):
            yield block if mark == wanted else block.replace(separator, wanted)

    def _blocks(self, sampler: _Sampler | None) -> Iterator[tuple[bytes, bytes]]:
        """Rows, and what stands between their cells."""
        line, unfinished = 1, b""
        for index, text in enumerate(self.text.blocks()):
            data, first = text.text, line
            if unfinished:
                data, first = unfinished + data, line - lines_in(unfinished)
            line += text.lines
            if first < self.first_line:
                if line <= self.first_line:
                    continue
                data = data.split(b"\n", self.first_line - first)[-1]
                first = self.first_line
            if sampler is None and index in self._as_it_is:
                yield data, self.separator.encode()
                continue
            block, unfinished, mark = self._rows(data, first, line <= self.text.lines, sampler)
            if sampler is not None and block is data:
                self._as_it_is.add(index)
            yield block, mark
        if unfinished:  # nothing follows any more
            raise AssertionError("the last rows were left for later")

    def _rows(
        self, data: bytes, first: int, file_goes_on: bool, sampler: _Sampler | None
    ) -> tuple[bytes, bytes, bytes]:
        """The rows of ``data``, what is left for later, and what stands between the cells."""
        if any(f"\n{stop}".encode() in b"\n" + data for stop in self.stops):
            raise NotInPieces
        unfinished, mark = b"", self.separator.encode()
        lines: Sequence[int] = range(first, first + lines_in(data))
        if self.comment and f"\n{self.comment}".encode() in b"\n" + data:
            filled_lines = [(n, line) for n, line in zip(lines, data.split(b"\n"), strict=False)
                    if not line.startswith(self.comment.encode())]  # fmt: skip
            data = b"".join(line + b"\n" for _, line in filled_lines)
            lines = [n for n, _ in filled_lines]
            self._dropped_only = False
        if b'"' in data:
            self.has_quotes = True
            marked_data = _without_quotes(data, mark)
            if marked_data is None:
                self._plain_quotes = False
                marked_data, lines, unfinished = self._carefully(data, lines, file_goes_on, sampler)
            data, mark = marked_data, _MARK
        return self._of_width(data, mark, lines, sampler), unfinished, mark

    def _carefully(
        self, data: bytes, lines: Sequence[int], file_goes_on: bool, sampler: _Sampler | None
    ) -> tuple[bytes, Sequence[int], bytes]:
        """Handle rows with quotes inside cells, cells of several lines, and quotes that are never
        closed."""
        texts = data.decode("utf-8").split("\n")[:-1]
        notes = None if sampler is None else sampler.quotes
        if self.comment:
            raise NotInPieces
        parsed_rows, used = whole_rows(
            texts, self.separator, lines[0], notes, file_goes_on=file_goes_on
        )
        unfinished = "".join(line + "\n" for line in texts[used:]).encode("utf-8")
        joined = (MARK.join(row).replace("\n", BREAK) + "\n" for row in parsed_rows.cells)
        return "".join(joined).encode("utf-8"), parsed_rows.numbers, unfinished

    def _of_width(
        self, data: bytes, mark: bytes, lines: Sequence[int], sampler: _Sampler | None
    ) -> bytes:
        """``data`` without the rows that do not count, which are told; the others are counted."""
        signs = np.frombuffer(data, dtype=np.uint8)
        ends = _ends_of_even_rows(signs, mark[0], self.width)
        is_even = ends is not None
        if ends is None:
            ends = np.flatnonzero(signs == 10)
        if sampler is not None and ends.size:
            stored = int(np.diff(ends, prepend=-1).max()) + 2 * self.width + 1  # quotes, CR
            self.longest = max(self.longest, stored)
        odd_rows: list[int] = []
        if not is_even:
            counts = np.diff(np.searchsorted(np.flatnonzero(signs == mark[0]), ends), prepend=0)
            odd_rows = np.flatnonzero(counts != self.width - 1).tolist()
        odd_rows += self._headers_again(data, mark, ends)
        if not odd_rows:
            self._count(lines, 0, ends.size, sampler)
            return data
        parts, rows_done, offset = [], 0, 0
        for row in sorted(set(odd_rows)):
            begin = int(ends[row - 1]) + 1 if row else 0
            end = int(ends[row]) + 1
            self._count(lines, rows_done, row, sampler)
            text = data[begin : end - 1].decode("utf-8")
            replacement = self._replacement(text, mark.decode(), lines[row], sampler)
            if replacement is not None:
                self._count(lines, row, row + 1, sampler)
            parts += [
                data[offset:begin],
                b"" if replacement is None else replacement.encode("utf-8"),
            ]
            rows_done, offset = row + 1, end
        self._count(lines, rows_done, ends.size, sampler)
        return b"".join((*parts, data[offset:]))

    def _replacement(
        self, text: str, mark: str, number: int, sampler: _Sampler | None
    ) -> str | None:
        """What stands for a row of another width, or one like a header; ``None`` where nothing."""
        if mark not in text and not text.strip():
            return None
        row = text.split(mark)
        if len(row) == self.width:
            if not self._is_header(row):
                return text + "\n"
            self._dropped_only = False
            self.header_rows += sampler is not None
            return None
        if len(row) > self.width and not any(cell.strip() for cell in row[self.width :]):
            self._dropped_only = False
            return mark.join(row[: self.width]) + "\n"
        if sampler is not None:
            cut = not self.text.ends_whole and number == self.text.lines
            row = [cell.replace(BREAK, "\n") for cell in row]
            sampler.widths.problem(row_left_out(number, row, self.width, cut=cut))
            self._left_out += 1
        return None

    def _is_header(self, row: Sequence[str]) -> bool:
        cells = [cell.replace(BREAK, "\n").strip() for cell in row]
        return any(cells == list(header) for header in self.headers)

    def _headers_again(self, data: bytes, mark: bytes, ends: np.ndarray) -> list[int]:
        """Rows whose first cell may be that of a header."""
        rows: list[int] = []
        for start in {header[0].replace("\n", BREAK) for header in self.headers}:
            if not start:
                firsts = np.concatenate([[0], ends[:-1] + 1])
                signs = np.frombuffer(data, dtype=np.uint8)
                rows += np.flatnonzero(np.isin(signs[firsts], (mark[0], 32, 9, 0xC2))).tolist()
                continue
            # Testing for one of its characters is quicker than searching for the whole.
            needle = start.encode("utf-8")
            offset = data.find(needle) if all(sign in data for sign in needle) else -1
            while offset >= 0:
                begin = data.rfind(b"\n", 0, offset) + 1
                if mark not in data[begin:offset]:
                    rows.append(int(np.searchsorted(ends, offset)))
                offset = data.find(needle, offset + 1)
        return rows

    def _count(self, lines: Sequence[int], begin: int, end: int, sampler: _Sampler | None) -> None:
        """Rows ``begin`` to ``end`` of a block count."""
        if sampler is None or begin >= end:
            return
        if isinstance(lines, range):
            self.numbers.extend(lines[begin], end - begin)
            return
        for row in range(begin, end):
            self.numbers.extend(lines[row], 1)


@dataclass
class _Sampler:
    """What the first pass tells of: quotes that are never closed, rows of another width."""

    quotes: ReadingNotes
    widths: ReadingNotes


def _ends_of_even_rows(signs: NDArray[np.uint8], mark: int, width: int) -> NDArray[np.intp] | None:
    """Where the rows end, if each has ``width`` cells; else ``None``."""
    marks = np.flatnonzero((signs == mark) | (signs == 10))
    ends = marks[width - 1 :: width]
    rows = np.count_nonzero(signs == 10)
    return ends if marks.size == rows * width and (signs[ends] == 10).all() else None


def _without_quotes(data: bytes, separator: bytes) -> bytes | None:
    """``data`` with ``MARK`` between cells and none of the quotes around cells; ``None`` where
    quotes are anything else, or a cell goes on in the next line."""
    quick = _all_quoted(data, separator)
    if quick is not None:
        return quick
    signs = np.frombuffer(data, dtype=np.uint8)
    is_quote = signs == 34
    quotes = np.flatnonzero(is_quote)
    if quotes.size % 2:
        return None
    opens, closes = quotes[::2], quotes[1::2]
    before, after = signs[opens - 1], signs[closes + 1]
    if opens[0] == 0:
        before = before.copy()
        before[0] = 10
    outer = np.array([separator[0], 10], dtype=np.uint8)
    if not (np.isin(before, outer).all() and np.isin(after, outer).all()):
        return None
    in_quotes = np.logical_xor.accumulate(is_quote)
    if (in_quotes & (signs == 10)).any():
        return None
    bare = np.where((signs == separator[0]) & ~in_quotes, _MARK[0], signs).astype(np.uint8)
    return bare.tobytes().translate(None, b'"')


def _all_quoted(data: bytes, separator: bytes) -> bytes | None:
    """The same where every cell is in quotes, which most such files have; else ``None``."""
    if not (data.startswith(b'"') and data.endswith(b'"\n')):
        return None
    rows = data[1:-2].replace(b'"\n"', b"\n")
    if len(data) - 3 - len(rows) != 2 * (lines_in(data) - 1):
        return None  # a line ends without a quote
    bare = rows.replace(b'"' + separator + b'"', _MARK)
    return None if b'"' in bare else bare + b"\n"
