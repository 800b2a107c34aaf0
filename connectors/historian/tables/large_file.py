"""Large wide exports, read in pieces: only the columns that are asked for, and never as a whole.

A file is plain where every byte of it shows that nothing can be misread by cutting it into pieces:
UTF-8 without quotes, lost bytes or a mark that could be a decimal comma, a wide table of no known
product, rows of one width but for a few. It then gives the same table, decisions and problems as
it does when it is read whole. Any other file is read whole.
"""

from __future__ import annotations

import codecs
import hashlib
from array import array
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.layouts import layout_of
from stemwatch.connectors.historian.layouts.generic import Generic, narrow_columns, refuse_text
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables.document import Document
from stemwatch.connectors.historian.tables.layout_input import LayoutInput
from stemwatch.connectors.historian.tables.raw_table import RawTable
from stemwatch.connectors.historian.tables.rows import Rows, row_left_out
from stemwatch.connectors.historian.tables.structure import (
    Structure,
    column_names,
    find_structure,
)
from stemwatch.connectors.historian.tables.wide import Body, wide_body
from stemwatch.connectors.historian.values.numbers import quick_numbers
from stemwatch.connectors.historian.values.stored_text import StoredText
from stemwatch.models.recording import Floats

if TYPE_CHECKING:
    import pyarrow as pa

LARGE_BYTES = 4 * 1024**2
_BLOCK = 8 * 1024**2
_HEAD_BYTES, _HEAD_LINES = 32 * 1024**2, 1000
_SPOTS, _SPOT_BYTES = 100, 1 << 12
_MOST_BAD_ROWS = 1000
_VOTERS = 500  # first cells of a column that show whether its numbers have a decimal point
_BOM = b"\xef\xbb\xbf"
_NOT_PLAIN = (b'"', b"\0", b"\x1a", b"\xc3\x82")  # the last: an encoding that was applied twice
_CONTROL = bytes(set(range(32)) - {9, 10, 13})


@dataclass(frozen=True, kw_only=True)
class LargeTable:
    """What stands for the document and the table of a file that is read in pieces."""

    digest: str
    encoding: str
    table: RawTable
    decimal: str
    columns: FileColumns


def open_large(path: Path, options: ReadOptions, notes: ReadingNotes) -> LargeTable | None:
    """The table of a large plain file; ``None``, with nothing noted, for any other.

    Raises ``UnreadableSource`` as reading it whole does where it is no recording.
    """
    try:
        if path.stat().st_size < LARGE_BYTES or options.encoding not in (None, "utf-8"):
            return None
        with path.open("rb") as file:
            return _open(file, path, options, notes)
    except OSError:
        return None  # whoever reads it whole says why


def _open(
    file: BinaryIO, path: Path, options: ReadOptions, notes: ReadingNotes
) -> LargeTable | None:
    sample = _sample(file)
    if sample is None or any(quote in sample for quote in _NOT_PLAIN):
        return None
    try:
        lines = sample.decode("utf-8-sig").replace("\r\n", "\n").split("\n")[:-1]
    except UnicodeDecodeError:
        return None
    own = ReadingNotes()
    encoding = "utf-8-sig" if sample.startswith(_BOM) else "utf-8"
    own.decide(f"The text is {encoding}.")
    document = Document(path=path, lines=lines, encoding=encoding, digest="", ends_whole=True)
    source = LayoutInput(document, options, own)
    if not isinstance(layout_of(source), Generic):
        return None
    separator = source.separator()
    rows = source.rows(separator)
    structure = find_structure(rows, options, source.name)
    header = column_names(structure).tags
    first_line = rows.numbers[structure.first_row]
    if (
        len(structure.time) > 1
        or structure.width < 2
        or structure.first_row >= _HEAD_LINES // 2
        or narrow_columns(source, rows, structure, header) is not None
    ):
        return None
    refuse_text(source, rows, structure)
    scan = _Scan(separator.encode(), structure, first_line, comma_free=options.decimal is None)
    if not scan.whole(file):
        return None
    return _table(path, source, rows, structure, separator, scan, options, notes)


def _sample(file: BinaryIO) -> bytes | None:
    """The first lines, and whole lines from everywhere."""
    head = b"".join(file.readline(_HEAD_BYTES) for _ in range(_HEAD_LINES))
    if len(head) > _HEAD_BYTES or not head.endswith(b"\n"):
        return None
    size = file.seek(0, 2)
    parts = [head]
    reached = len(head)
    for at in np.linspace(len(head), size, _SPOTS + 1)[:-1].astype(int).tolist():
        file.seek(max(at, reached) - 1)
        file.readline()
        begin = file.tell()
        spot = file.read(max(_SPOT_BYTES, 4 * len(head) // _HEAD_LINES))
        parts.append(spot[: spot.rfind(b"\n") + 1])
        reached = begin + len(parts[-1])  # in the order of the file, nothing twice
    return b"".join(parts)


@dataclass
class _Scan:
    """One pass over all bytes: whether they are plain, their digest, and rows of another width."""

    separator: bytes
    structure: Structure
    first_line: int
    comma_free: bool
    lines: int = 0
    has_point: bool = False
    ends_whole: bool = True
    left_out: dict[int, bytes] = field(default_factory=dict)  # by line
    blank: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._hash = hashlib.sha256()
        self._utf8 = codecs.getincrementaldecoder("utf-8")()
        starts = {row[0].encode() for row in self.structure.headers}
        self._headers = tuple(b"\n" + start for start in starts)

    @property
    def digest(self) -> str:
        """Of the file's bytes."""
        return self._hash.hexdigest()

    def whole(self, file: BinaryIO) -> bool:
        """Whether the file is plain to its end."""
        file.seek(0)
        rest = b""
        while block := file.read(_BLOCK):
            self._hash.update(block)
            cut = block.rfind(b"\n") + 1
            if not cut:
                rest += block
                continue
            if not self._takes(rest + block[:cut]):
                return False
            rest = block[cut:]
        self.ends_whole = not rest
        return not rest or self._takes(rest + b"\n")

    def _takes(self, block: bytes) -> bool:
        if any(sign in block for sign in _NOT_PLAIN) or block.count(b"\r") != block.count(b"\r\n"):
            return False
        if len(block.translate(None, _CONTROL)) != len(block):
            return False
        try:
            if not block.isascii():
                self._utf8.decode(block)
        except UnicodeDecodeError:
            return False
        data = block
        if self.lines < self.first_line - 1:
            parts = block.split(b"\n", self.first_line - 1 - self.lines)
            data = parts[-1]
            self.lines += len(parts) - 1
        if self.comma_free and self.separator != b"," and b"," in data:
            return False
        if any(header in b"\n" + data for header in self._headers):
            return False
        self.has_point = self.has_point or b"." in data
        return self._count(data)

    def _count(self, data: bytes) -> bool:
        """Look for rows of another width; whether each of them can be left out."""
        signs = np.frombuffer(data, dtype=np.uint8)
        ends = np.flatnonzero(signs == 10)
        marks = np.flatnonzero(signs == self.separator[0])
        each = self.structure.width - 1
        first, self.lines = self.lines + 1, self.lines + ends.size
        if marks.size == each * ends.size:
            table = marks.reshape(ends.size, each)
            if (table[:, -1] < ends).all() and (table[1:, 0] > ends[:-1]).all():
                return True
        counts = np.diff(np.searchsorted(marks, ends), prepend=0)
        starts = np.concatenate([[0], ends[:-1] + 1])
        for row in np.flatnonzero(counts != each).tolist():
            line = data[starts[row] : ends[row]].rstrip(b"\r")
            if not line.strip():
                self.blank.append(first + row)
                continue
            spare = line.split(self.separator)[each + 1 :]
            if spare and not any(cell.strip() for cell in spare):
                return False  # empty cells at the end are no fault, and the row counts
            self.left_out[first + row] = line
        return len(self.left_out) + len(self.blank) <= _MOST_BAD_ROWS


def _table(
    path: Path,
    source: LayoutInput,
    rows: Rows,
    structure: Structure,
    separator: str,
    scan: _Scan,
    options: ReadOptions,
    notes: ReadingNotes,
) -> LargeTable | None:
    for line, text in scan.left_out.items():
        cells = text.decode("utf-8").split(separator)
        cut = not scan.ends_whole and line == scan.lines
        source.notes.problem(row_left_out(line, cells, structure.width, cut=cut))
    numbers = _line_numbers(scan)
    columns = FileColumns(path, separator, structure.width, scan.first_line, len(numbers))
    stored: list[Sequence[str]] = [columns.cells(place) for place in range(structure.width)]
    table = wide_body(
        source, Body(stored, numbers), structure, separator, "wide table: one column per tag"
    )
    decimal = _decimal(table, rows, structure, scan, options, source.notes)
    if decimal is None:
        return None
    notes.take(source.notes)
    return LargeTable(
        digest=scan.digest,
        encoding=source.document.encoding,
        table=table,
        decimal=decimal,
        columns=columns,
    )


def _line_numbers(scan: _Scan) -> Sequence[int]:
    numbers = range(scan.first_line, scan.lines + 1)
    if not scan.left_out and not scan.blank:
        return numbers
    gone = {*scan.left_out, *scan.blank}
    return array("q", (number for number in numbers if number not in gone))


def _decimal(
    table: RawTable,
    rows: Rows,
    structure: Structure,
    scan: _Scan,
    options: ReadOptions,
    notes: ReadingNotes,
) -> str | None:
    """The decimal mark of a file in which no cell has a comma, as ``decide_decimal`` finds it.

    ``None`` where later cells may show a point, and the first of that column do not.
    """
    if options.decimal is not None:
        return options.decimal
    if not scan.has_point:
        notes.decide("No number has a decimal mark; a point is taken.")
        return "."
    body = [row for row in rows.cells[structure.first_row :] if len(row) == structure.width]
    unsure = False
    for column in table.columns:
        if isinstance(column.cells, StoredText):
            cells = [row[column.cells.place] for row in body[:_VOTERS]]
            if quick_numbers(cells, ".") is None:
                continue
            if not any("." in cell for cell in cells):
                unsure = True
                continue
            notes.decide("The decimal mark is a point.")
            return "."
    if unsure:
        return None
    notes.decide("No number has a decimal mark; a point is taken.")
    return "."


class FileColumns:
    """The columns of a plain file. What was read is kept until it was taken."""

    def __init__(self, path: Path, separator: str, width: int, first_line: int, size: int) -> None:
        self._path, self._separator, self._width = path, separator, width
        self._first_line, self._size = first_line, size
        self._text: dict[int, pa.Array] = {}
        self._numbers: dict[int, Floats | None] = {}

    def cells(self, index: int) -> StoredText:
        """A column, of which nothing is read yet."""
        return StoredText(index, self._size, self._text_of, self._numbers_of, self._first_of)

    def read_ahead(self, indices: Sequence[int]) -> None:
        """Read the numbers of several columns in one pass."""
        import pyarrow as pa

        wanted = [index for index in indices if index not in self._numbers]
        if not wanted:
            return
        try:
            read = self._read(wanted, pa.float64())
        except pa.ArrowInvalid:  # a word among the numbers
            for index, text in zip(wanted, self._read(wanted, pa.string()), strict=True):
                self._text[index] = text
                self._numbers[index] = _plain(text)
            return
        for index, column in zip(wanted, read, strict=True):
            values = column.to_numpy(zero_copy_only=False)
            self._numbers[index] = values if np.isfinite(values).all() else None

    def forget(self, index: int) -> None:
        """Keep nothing of this column any more."""
        self._text.pop(index, None)
        self._numbers.pop(index, None)

    def _numbers_of(self, index: int) -> Floats | None:
        self.read_ahead([index])
        return self._numbers[index]

    def _text_of(self, index: int) -> pa.Array:
        import pyarrow as pa

        if index not in self._text:
            (self._text[index],) = self._read([index], pa.string())
        return self._text[index]

    def _first_of(self, index: int, count: int) -> pa.Array:
        import pyarrow as pa

        return self._read([index], pa.string(), min(count, self._size))[0]

    def _read(
        self, indices: Sequence[int], kind: pa.DataType, most: int | None = None
    ) -> list[pa.Array]:
        import pyarrow as pa
        import pyarrow.csv as csv

        names = [str(index) for index in range(self._width)]
        chosen = [names[index] for index in indices]
        reader = csv.open_csv(
            self._path,
            read_options=csv.ReadOptions(
                use_threads=False,
                block_size=max(_BLOCK, 64 * self._width),
                skip_rows=self._first_line - 1,
                column_names=names,
            ),
            parse_options=csv.ParseOptions(
                delimiter=self._separator,
                quote_char=False,
                invalid_row_handler=lambda row: "skip",
            ),
            convert_options=csv.ConvertOptions(
                include_columns=chosen,
                column_types=dict.fromkeys(chosen, kind),
                null_values=[],
                strings_can_be_null=False,
            ),
        )
        batches: list[list[pa.Array]] = [[] for _ in indices]
        wanted, there = self._size if most is None else most, 0
        for batch in reader:
            there += batch.num_rows
            for place, column in enumerate(batch.columns):
                batches[place].append(column)
            if there >= wanted:
                break  # a historian may go on writing
        columns = []
        for place in range(len(indices)):
            parts, batches[place] = batches[place], []
            columns.append(pa.concat_arrays(parts) if parts else pa.array([], kind))
        if there < wanted:
            raise UnreadableSource(
                f"{self._path}: has become shorter while it was read; read it again when nobody "
                "writes it any more"
            )
        return [column[:wanted] for column in columns]


def _plain(text: pa.Array) -> Floats | None:
    import pyarrow as pa
    import pyarrow.compute as pc

    try:
        values = pc.cast(text, pa.float64()).to_numpy(zero_copy_only=False)
    except pa.ArrowInvalid:
        return None
    return values if np.isfinite(values).all() else None
