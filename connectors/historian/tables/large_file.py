"""Large exports, read in pieces: only the columns and tags that are asked for, never as a whole.

A layout parses ``LargeInput`` as it parses any file: it is shown the first lines and lines from
everywhere, and ``body`` gives columns whose cells stay in the file. Where the pieces cannot show
what the whole file would, ``NotInPieces`` says so, and the file is read whole.
"""

from __future__ import annotations

import io
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables import text_pieces
from stemwatch.connectors.historian.tables.document import Document
from stemwatch.connectors.historian.tables.layout_input import Body, LayoutInput
from stemwatch.connectors.historian.tables.row_pieces import BREAK, RowPieces
from stemwatch.connectors.historian.tables.rows import Rows, split_rows
from stemwatch.connectors.historian.tables.text_pieces import NotInPieces, TextPieces
from stemwatch.connectors.historian.values.stored_text import (
    Kinds,
    StoredText,
    code_texts,
    joined_codes,
)
from stemwatch.models.recording import Floats

if TYPE_CHECKING:
    import pyarrow as pa

LARGE_BYTES = 4 * 1024**2
_PACKED = 10  # typical compression factor of exports
_ROWS_AT_ONCE = 200_000  # rows per pass in which cells of many tags are read
_MOST_CODES = 2**16  # different texts of a column that a code of two bytes can distinguish


@dataclass(frozen=True)
class LargeInput(LayoutInput):
    """What ``LayoutInput`` is for a file that is read whole. ``document`` holds lines from
    everywhere, the first ones without a gap."""

    text: TextPieces

    def rows(self, separator: str, first: int = 0, comment: str = "") -> Rows:
        """Rows of the lines that are shown; numbered truly where no line is missing before."""
        lines = self._without_comments(self.document.lines[first:], comment)
        return split_rows(lines, separator, first + 1)

    def all_lines(self) -> Sequence[str]:
        raise NotInPieces

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
        if first >= len(rows.cells) or rows.numbers[first] > len(self.text.head) // 2:
            raise NotInPieces
        pieces = RowPieces(
            text=self.text,
            separator=separator,
            width=width,
            first_line=rows.numbers[first],
            headers=headers,
            comment=comment,
            stops=stops,
        )
        pieces.look_through(self.notes)
        columns = FileColumns(self.text.path, pieces)
        return Body(
            [StoredText(columns, (column_index,)) for column_index in range(width)], pieces.numbers
        )


def large_input(path: Path, options: ReadOptions) -> LargeInput | None:
    """A large file that may be read in pieces; ``None`` for any other.

    Raises ``UnreadableSource`` as reading it whole does where it is no text.
    """
    try:
        size = path.stat().st_size
        if size * _PACKED < LARGE_BYTES:
            return None
        if size < LARGE_BYTES and not text_pieces.is_packed(path):
            return None
        text = text_pieces.look_through(path, options.encoding)
    except (OSError, NotInPieces):
        return None  # reading it whole reports the error
    lines = text.head + text.spots
    document = Document(
        path=path, lines=lines, encoding=text.encoding, digest=text.digest, ends_whole=True
    )
    notes = ReadingNotes()
    notes.take(text.notes)
    return LargeInput(document, options, notes, text)


class FileColumns:
    """The columns of a file's rows, read by Arrow."""

    def __init__(self, path: Path, rows: RowPieces) -> None:
        self._path, self._rows = path, rows
        self._with_words: set[int] = set()  # columns in which cells are no numbers
        self._next: tuple[Sequence[StoredText], str] | None = None
        self.codes: dict[int, tuple[list[str], Kinds]] = {}

    @property
    def size(self) -> int:
        """Rows of the table."""
        return len(self._rows.numbers)

    @property
    def has_comma(self) -> bool:
        """Whether a cell of any column has a comma."""
        return self._rows.has_comma

    @property
    def has_point(self) -> bool:
        """Whether a cell of any column has a point."""
        return self._rows.has_point

    def batches(self, places: Sequence[int], rows: int | None = None) -> Iterator[list[pa.Array]]:
        """The text of columns, some rows at a time, of all rows or the first ones."""
        import pyarrow as pa

        rows_done = 0
        if rows is None and self._next is not None:
            (numbers, mark), self._next = self._next, None
            try:
                for batch in self._passed(numbers, [], mark, pa.float64(), places):
                    yield batch
                    rows_done += len(batch[0])
                return
            except pa.ArrowInvalid:  # not all cells are numbers: the column is read later as text
                pass
        for batch in self._batches(dict.fromkeys(places, pa.string()), places, ".", rows):
            skipped = min(rows_done, len(batch[0]))
            rows_done -= skipped
            if skipped < len(batch[0]):
                yield [column[skipped:] for column in batch]

    def read_next(self, numbers: Sequence[StoredText], mark: str) -> None:
        """The next pass over all rows reads these too, if each of their cells is a number."""
        wanted = [cells for cells in numbers if cells.numbers is None and cells.text is None]
        plain = not any(cells.combine or set(cells.places) & self._with_words for cells in wanted)
        self._next = (wanted, mark) if wanted and plain else None

    def read(self, numbers: Sequence[StoredText], texts: Sequence[StoredText], mark: str) -> None:
        """Fill in the numbers or the texts of these in one pass. ``mark``: the decimal mark."""
        import pyarrow as pa

        self._next = None
        numbers = [
            request for request in numbers if request.numbers is None and request.text is None
        ]
        texts = [request for request in texts if request.text is None]
        if not numbers and not texts:
            return
        places = {column_index for request in numbers for column_index in request.places}
        combined = any(request.combine is not None for request in numbers)
        if not combined and not places & self._with_words:
            try:
                deque(self._passed(numbers, texts, mark, pa.float64()), maxlen=0)
            except pa.ArrowInvalid:  # a word among the numbers
                if len(places) == 1:
                    self._with_words |= places
            else:
                return
        deque(self._passed(numbers, texts, mark, pa.string()), maxlen=0)

    def code(self, places: Sequence[int]) -> None:
        """Store these columns, which have few different texts, in ``codes`` as numbers of two
        bytes, in one pass. A column with too many different texts is not stored."""
        index_of_text: dict[int, dict[str, int]] = {place: {} for place in places}
        parts: dict[int, list[Kinds]] = {place: [] for place in places}
        for batch in self.batches(places):
            for place, text in zip(places, batch, strict=True):
                if place in parts:
                    parts[place].append(code_texts(text, index_of_text[place]))
                if len(index_of_text[place]) >= _MOST_CODES:
                    parts.pop(place, None)
        for place, kinds in parts.items():
            self.codes[place] = (list(index_of_text[place]), joined_codes(kinds))

    def _passed(
        self,
        numbers: Sequence[StoredText],
        texts: Sequence[StoredText],
        mark: str,
        kind: pa.DataType,
        others: Sequence[int] = (),
    ) -> Iterator[list[pa.Array]]:
        """One pass that reads these columns; yields the text of the columns ``others``
        meanwhile."""
        import pyarrow as pa

        kinds = {column_index: kind for request in numbers for column_index in request.places}
        kinds |= {column_index: pa.string() for request in texts for column_index in request.places}
        kinds |= dict.fromkeys(others, pa.string())
        requests = [*numbers, *texts]
        parts: list[list[pa.Array]] = [[] for _ in requests]
        rows_read, most = 0, _rows_needed(requests)
        batches = self._batches(kinds, list(kinds), mark, None if others else most)
        for batch in batches if most is None else _larger(batches):
            by_place = dict(zip(kinds, batch, strict=True))
            yield [by_place[column_index] for column_index in others]
            for request, part in zip(requests, parts, strict=True):
                cells = _chosen(request, by_place, rows_read, len(batch[0]))
                if cells is not None:
                    part.append(cells)
            rows_read += len(batch[0])
        for request, part in zip(requests, parts, strict=True):
            is_text = kinds[request.places[0]] == pa.string()
            column = pa.concat_arrays(part) if part else pa.array([], kinds[request.places[0]])
            part.clear()
            is_number = request in numbers
            values = (
                None
                if not is_number
                else _numbers_without_separators(column, mark)
                if is_text
                else _finite(column)
            )
            if is_text and values is None:
                request.text = column
            if is_number:
                request.numbers = values

    def _batches(
        self,
        kinds: dict[int, pa.DataType],
        places: Sequence[int],
        mark: str,
        most_rows: int | None = None,
    ) -> Iterator[list[pa.Array]]:
        import pyarrow as pa
        import pyarrow.compute as pc

        rows_wanted, rows_read = self.size if most_rows is None else min(most_rows, self.size), 0
        if not rows_wanted:
            return
        stored: BinaryIO | _Stream = (
            self._stored() if self._rows.as_stored else _Stream(self._rows.blocks())
        )
        with pa.PythonFile(stored, mode="r") as file:
            for batch in self._parsed(file, kinds, mark):
                columns = [
                    batch.column(str(column_index))[: rows_wanted - rows_read]
                    for column_index in places
                ]
                if self._rows.has_break:
                    columns = [
                        pc.replace_substring(column, BREAK, "\n")
                        if column.type == pa.string()
                        else column
                        for column in columns
                    ]
                rows_read += len(columns[0])
                yield columns
                if rows_read >= rows_wanted:
                    return  # a historian may go on writing
        raise UnreadableSource(
            f"{self._path}: has become shorter while it was read; read it again when nobody "
            "writes it any more"
        )

    def _parsed(
        self, file: pa.PythonFile, kinds: dict[int, pa.DataType], mark: str
    ) -> Iterable[pa.RecordBatch]:
        import pyarrow.csv as csv

        rows, chosen = self._rows, [str(column_index) for column_index in kinds]
        reader: Iterable[pa.RecordBatch] = csv.open_csv(
            file,
            read_options=csv.ReadOptions(
                use_threads=False,
                block_size=max(text_pieces.BLOCK, 2 * rows.longest),
                column_names=[str(column_index) for column_index in range(rows.width)],
            ),
            parse_options=csv.ParseOptions(
                delimiter=rows.separator if rows.as_stored else rows.mark,
                quote_char='"' if rows.as_stored and rows.has_quotes else False,
                invalid_row_handler=lambda row: "skip",
            ),
            convert_options=csv.ConvertOptions(
                include_columns=chosen,
                column_types={str(column_index): kind for column_index, kind in kinds.items()},
                null_values=[],
                strings_can_be_null=False,
                decimal_point=mark,
            ),
        )
        return reader

    def _stored(self) -> BinaryIO:
        """The file from its first row on. Arrow, given a path, would read far ahead and keep it."""
        file = self._path.open("rb")
        for _ in range(self._rows.first_line - 1):
            file.readline()
        return file


class _Stream(io.RawIOBase):
    """Blocks as a file that Arrow reads."""

    def __init__(self, blocks: Iterator[bytes]) -> None:
        self._blocks, self._left = blocks, memoryview(b"")

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        while not self._left:
            block = next(self._blocks, None)
            if block is None:
                return 0
            self._left = memoryview(block)
        room = memoryview(buffer)
        count = min(len(room), len(self._left))
        room[:count] = self._left[:count]
        self._left = self._left[count:]
        return count


def _rows_needed(requests: Sequence[StoredText]) -> int | None:
    """Rows of the table up to the last one that a column wants; ``None`` where one wants all."""
    rows = [request.rows for request in requests if request.rows is not None]
    if len(rows) < len(requests):
        return None
    return max((int(chosen[-1]) + 1 for chosen in rows if len(chosen)), default=0)


def _larger(batches: Iterator[list[pa.Array]]) -> Iterator[list[pa.Array]]:
    """The batches joined into larger ones, where each column takes only some rows of them: the cost
    of a column in each batch matters where a batch has thousands of tags."""
    import pyarrow as pa

    buffered: list[list[pa.Array]] = []
    for batch in batches:
        buffered.append(batch)
        if sum(len(columns[0]) for columns in buffered) >= _ROWS_AT_ONCE:
            yield [pa.concat_arrays(column) for column in zip(*buffered, strict=True)]
            buffered = []
    if buffered:
        yield [pa.concat_arrays(column) for column in zip(*buffered, strict=True)]


def _chosen(
    request: StoredText, batch: dict[int, pa.Array], rows_before: int, count: int
) -> pa.Array | None:
    """Those of a batch's cells that belong to this column; ``rows_before`` rows came before it."""
    import pyarrow as pa

    cells = request.of([batch[column_index] for column_index in request.places])
    if request.rows is None:
        return cells
    # Bounds in the rows' own type: with another type, all rows would be converted first.
    bounds = np.array((rows_before, rows_before + count), dtype=request.rows.dtype)
    begin, end = np.searchsorted(request.rows, bounds)
    return cells.take(pa.array(request.rows[begin:end] - rows_before)) if begin < end else None


def _finite(cells: pa.Array) -> Floats | None:
    values = cells.to_numpy(zero_copy_only=False)
    return values if np.isfinite(values).all() else None


def _numbers_without_separators(text: pa.Array, mark: str) -> Floats | None:
    import pyarrow as pa
    import pyarrow.compute as pc

    if mark != ".":
        if pc.any(pc.match_substring(text, ".")).as_py():
            return None
        text = pc.replace_substring(text, mark, ".")
    try:
        return _finite(pc.cast(text, pa.float64()))
    except pa.ArrowInvalid:
        return None
