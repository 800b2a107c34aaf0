"""The cells of one column of a large file: text that stays in the file until it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, overload

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats

if TYPE_CHECKING:
    import pyarrow as pa

Rows = NDArray[np.int64] | NDArray[np.int32]
Kinds = NDArray[np.integer[Any]]
Combine = Callable[[list["pa.Array"]], "pa.Array"]
_PIECE = 200_000  # cells that are Python texts at one time


class StoredColumns(Protocol):
    """The columns of a file that is read in pieces."""

    @property
    def size(self) -> int:
        """Rows of the table."""
        ...

    @property
    def has_comma(self) -> bool:
        """Whether a cell of any column has a comma."""
        ...

    @property
    def has_point(self) -> bool:
        """Whether a cell of any column has a point."""
        ...

    @property
    def codes(self) -> dict[int, tuple[list[str], Kinds]]:
        """Of columns that were coded: their different texts, and which of them each cell is."""
        ...

    def code(self, places: Sequence[int]) -> None:
        """Put columns of which few texts come again and again into ``codes``, in one pass."""
        ...

    def batches(self, places: Sequence[int], rows: int | None = None) -> Iterator[list[pa.Array]]:
        """The text of columns, some rows at a time, of all rows or the first ones."""
        ...

    def read(self, numbers: Sequence[StoredText], texts: Sequence[StoredText], mark: str) -> None:
        """Fill in the numbers or the texts of these in one pass."""
        ...

    def read_next(self, numbers: Sequence[StoredText], mark: str) -> None:
        """The next pass over all rows may fill in the numbers of these too."""
        ...


@dataclass(eq=False)
class StoredText(Sequence[str]):
    """Cells of the file's columns ``places``, blanks at both ends taken off.

    ``combine`` makes one column of several; ``rows`` are those of the table that count, in order,
    ``None`` for all. What was read is kept until ``forget``.
    """

    columns: StoredColumns
    places: tuple[int, ...]
    combine: Combine | None = None
    rows: Rows | None = None
    text: pa.Array | None = field(default=None, repr=False)
    numbers: Floats | None = field(default=None, repr=False)

    def __len__(self) -> int:
        return self.columns.size if self.rows is None else len(self.rows)

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, at: slice) -> list[str]: ...
    def __getitem__(self, at: int | slice) -> str | list[str]:
        if isinstance(at, slice):
            begin, end, step = at.indices(len(self))
            if self.text is None and begin == 0 and step == 1 and end <= _PIECE:
                return self.first(end)
            return [cell.strip() for cell in self.whole()[at].to_pylist()]
        codes = self.codes
        if codes is not None:
            return codes[0][int(codes[1][at])]
        if self.text is None:
            return self.at(np.array([at]))[0]
        return str(self.text[at].as_py()).strip()

    def __iter__(self) -> Iterator[str]:
        for piece in self.pieces():
            yield from piece

    @property
    def codes(self) -> tuple[list[str], Kinds] | None:
        """The different texts of the column, and which of them each cell is, if it was coded."""
        known = self.columns.codes.get(self.places[0]) if self.combine is None else None
        return known if known is None or self.rows is None else (known[0], known[1][self.rows])

    def first(self, count: int) -> list[str]:
        """The first cells, without reading the others."""
        if self.rows is not None:
            return self.at(np.arange(min(count, len(self))))
        cells: list[str] = []
        for columns in self.columns.batches(self.places, min(count, len(self))):
            cells += self.of(columns).to_pylist()
        return [cell.strip() for cell in cells[:count]]

    def at(self, chosen: Rows) -> list[str]:
        """The cells in these places of the column, which are in order."""
        rows = chosen if self.rows is None else self.rows[chosen]
        part = StoredText(self.columns, self.places, self.combine, rows)
        return [cell.strip() for cell in part.whole().to_pylist()]

    def only(self, rows: Rows) -> StoredText:
        """The cells of these rows of the table."""
        return StoredText(self.columns, self.places, self.combine, rows)

    def of(self, columns: Sequence[pa.Array]) -> pa.Array:
        """This column's cells of one batch, of all rows of the table."""
        return columns[0] if self.combine is None else self.combine(list(columns))

    def arrays(self) -> Iterator[pa.Array]:
        """The cells in order as Arrow text, some at a time."""
        if self.text is not None or self.rows is not None:
            text = self.whole()
            for first in range(0, len(text), _PIECE):
                yield text[first : first + _PIECE]
            return
        for columns in self.columns.batches(self.places):
            text = self.of(columns)
            for first in range(0, len(text), _PIECE):
                yield text[first : first + _PIECE]

    def pieces(self) -> Iterator[list[str]]:
        """The cells in order, so many at a time that they need little memory."""
        for text in self.arrays():
            yield [cell.strip() for cell in text.to_pylist()]

    def whole(self) -> pa.Array:
        """All cells as Arrow text, blanks and all."""
        if self.text is None:
            self.columns.read([], [self], ".")
        assert self.text is not None
        return self.text

    def forget(self) -> None:
        """Release the text and the numbers that were read."""
        self.text = self.numbers = None

    def plain_numbers(self, decimal: str) -> Floats | None:
        """(n,) numbers where every cell is one with this mark and nothing else; else ``None``."""
        if self.numbers is None and self.text is None:
            self.columns.read([self], [], decimal)
        return self.numbers

    def numbers_and_rest(self, decimal: str) -> tuple[Floats, list[int], list[str]]:
        """(n,) numbers of the plain cells; the rows of all others, and their texts."""
        import pyarrow as pa
        import pyarrow.compute as pc

        text = pc.ascii_trim_whitespace(self.whole())
        mark = r"\." if decimal == "." else ","
        pattern = rf"^-?(?:[0-9]+{mark}?[0-9]*|{mark}[0-9]+)(?:[eE][+-]?[0-9]+)?$"
        plain_number = pc.match_substring_regex(text, pattern)
        numbers = text.filter(plain_number)
        if decimal != ".":
            numbers = pc.replace_substring(numbers, ",", ".")
        is_plain = np.asarray(plain_number.to_numpy(zero_copy_only=False), dtype=bool)
        values = np.full(len(self), np.nan)
        values[is_plain] = pc.cast(numbers, pa.float64()).to_numpy(zero_copy_only=False)
        values[~np.isfinite(values)] = np.nan
        other_rows = np.flatnonzero(~is_plain)
        return values, other_rows.tolist(), text.take(pa.array(other_rows)).to_pylist()


def has_been_read(cells: Sequence[str]) -> bool:
    """Whether nothing has to be read from a file to convert ``cells``."""
    return not isinstance(cells, StoredText) or cells.text is not None or cells.numbers is not None


def coded(cells: Sequence[str]) -> tuple[list[str], Kinds]:
    """The different cells, blanks at both ends taken off, in the order in which they first come;
    (n,) which of them each cell is."""
    index_of_text: dict[str, int] = {}
    if isinstance(cells, StoredText):
        codes = cells.codes
        if codes is not None:
            return _those_that_come(*codes)
        parts = [code_texts(text, index_of_text) for text in cells.arrays()]
        return list(index_of_text), joined_codes(parts)
    kinds = (index_of_text.setdefault(cell.strip(), len(index_of_text)) for cell in cells)
    kind_index = np.fromiter(kinds, dtype=np.intp, count=len(cells))
    return list(index_of_text), kind_index


def forget_codes(cells: Sequence[str]) -> None:
    """Release what ``code_together`` read of a column."""
    if isinstance(cells, StoredText):
        cells.columns.codes.pop(cells.places[0], None)


def code_together(columns: Sequence[Sequence[str]]) -> None:
    """Read what ``coded`` tells of these columns in one pass, where they stay in their file."""
    stored = [cells for cells in columns if isinstance(cells, StoredText) and cells.combine is None]
    if len(stored) > 1:
        stored[0].columns.code([cells.places[0] for cells in stored])


def code_texts(text: pa.Array, index_of_text: dict[str, int]) -> Kinds:
    """(n,) which of ``index_of_text`` each text is, blanks at both ends taken off; new ones are
    added there."""
    import pyarrow.compute as pc

    # The tags of one moment mostly come in the same order as those of the moment before.
    period = pc.index(text[1:], text[0]).as_py() + 1 if len(text) else 0
    if period and text[period:].equals(text[:-period]):
        of_period = code_texts(text[:period], index_of_text)
        repeated: Kinds = np.tile(of_period, len(text) // period + 1)[: len(text)]
        return repeated
    words = text.dictionary_encode()
    places = [
        index_of_text.setdefault(w.strip(), len(index_of_text))
        for w in words.dictionary.to_pylist()
    ]
    kind = np.min_scalar_type(max(len(index_of_text) - 1, 0))
    kind_index: Kinds = np.array(places, dtype=kind)[words.indices.to_numpy(zero_copy_only=False)]
    return kind_index


def joined_codes(parts: Sequence[Kinds]) -> Kinds:
    """(n,) the codes of all batches of a column, one after the other."""
    codes: Kinds = np.concatenate(parts) if parts else np.zeros(0, dtype=np.uint16)
    return codes


def _those_that_come(texts: list[str], kind_index: Kinds) -> tuple[list[str], Kinds]:
    """The same without texts that no cell has, in the order in which they first come."""
    if len(texts) == 1 and kind_index.size:
        return texts, kind_index
    kinds, firsts = np.unique(kind_index, return_index=True)
    order = np.argsort(firsts)
    new_index = np.zeros(len(texts), dtype=np.uint16)
    new_index[kinds[order]] = np.arange(kinds.size)
    return [texts[kind] for kind in kinds[order].tolist()], new_index[kind_index]


def neighbours_once(text: pa.Array) -> tuple[pa.Array, Kinds]:
    """The text with equal neighbours once, and how often each stands there."""
    import pyarrow.compute as pc

    runs = pc.run_end_encode(text)
    return runs.values, np.diff(runs.run_ends.to_numpy(), prepend=0)


def rows_of_each(kind_index: Kinds, kinds: int) -> list[Rows]:
    """The rows of each kind in order; ``kind_index`` (n,) tells the kind of each row."""
    narrow = np.int32 if kind_index.size < 2**31 else np.int64
    counts = np.bincount(kind_index, minlength=kinds)
    order = np.empty(kind_index.size, dtype=narrow)
    free = np.cumsum(counts) - counts  # the next place of each kind
    for begin in range(0, kind_index.size, _PIECE):
        part = kind_index[begin : begin + _PIECE]
        by_kind = np.argsort(part, kind="stable")
        sorted_kinds = part[by_kind]
        starts = np.searchsorted(sorted_kinds, np.arange(kinds))
        order[free[sorted_kinds] + np.arange(part.size) - starts[sorted_kinds]] = by_kind + begin
        free += np.bincount(part, minlength=kinds)
    return np.split(order, np.cumsum(counts)[:-1]) if kinds else []


def chosen(cells: Sequence[str], rows: Rows) -> Sequence[str]:
    """The cells of these rows."""
    if isinstance(cells, StoredText):
        return cells.only(rows)
    return [cells[row] for row in rows.tolist()]


def cells_at(cells: Sequence[str], rows: Rows) -> list[str]:
    """The cells of a few rows, in order, read at once."""
    if isinstance(cells, StoredText):
        return cells.at(rows)
    return [cells[row] for row in rows.tolist()]


def joined(date: Sequence[str], clock: Sequence[str]) -> Sequence[str]:
    """Each cell of two columns as one text, with a blank between them."""
    if isinstance(date, StoredText) and isinstance(clock, StoredText):
        return StoredText(date.columns, (*date.places, *clock.places), _with_blank)
    return [
        f"{date_cell.strip()} {other.strip()}" for date_cell, other in zip(date, clock, strict=True)
    ]


def _with_blank(columns: list[pa.Array]) -> pa.Array:
    import pyarrow as pa
    import pyarrow.compute as pc

    date, clock = (pc.utf8_trim_whitespace(column) for column in columns)
    return pc.binary_join_element_wise(date, clock, pa.scalar(" "))


def first_filled(cells: Sequence[str], others: Sequence[str]) -> Sequence[str]:
    """Each cell of ``cells``, or the one of ``others`` beside it where it is blank."""
    if isinstance(cells, StoredText) and isinstance(others, StoredText):
        return StoredText(cells.columns, (*cells.places, *others.places), _filled)
    return [cell if cell.strip() else other for cell, other in zip(cells, others, strict=True)]


def _filled(columns: list[pa.Array]) -> pa.Array:
    import pyarrow.compute as pc

    blank = pc.equal(pc.utf8_trim_whitespace(columns[0]), "")
    return pc.if_else(blank, columns[1], columns[0])


def change_each(cells: Sequence[str], change: Callable[[str], str]) -> Sequence[str]:
    """Each cell changed alone."""
    return make_of_rows([cells], lambda cells_of_row: change(cells_of_row[0]))


def make_of_rows(
    columns: Sequence[Sequence[str]], make: Callable[[Sequence[str]], str]
) -> Sequence[str]:
    """One text of the cells of each row. Of a file in pieces each different row is made once."""
    stored = [column for column in columns if isinstance(column, StoredText)]
    if not stored or len(stored) < len(columns):
        return [make(row) for row in zip(*columns, strict=True)]

    def made(cells: list[pa.Array]) -> pa.Array:
        import pyarrow as pa

        code = np.zeros(len(cells[0]), dtype=np.int64)
        for column in cells:
            encoded = column.dictionary_encode()
            code = code * len(encoded.dictionary) + encoded.indices.to_numpy(zero_copy_only=False)
        distinct, rows = np.unique(code, return_index=True)
        texts = pa.array([make([column[row].as_py() for column in cells]) for row in rows.tolist()])
        return texts.take(pa.array(np.searchsorted(distinct, code)))

    places = tuple(column_index for column in stored for column_index in column.places)
    return StoredText(stored[0].columns, places, made)
