"""The cells of one column of a large file: text that stays in the file until it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, overload

import numpy as np

from stemwatch.models.recording import Floats

if TYPE_CHECKING:
    import pyarrow as pa

_PIECE = 200_000  # cells that are Python texts at one time


class StoredText(Sequence[str]):
    """As many cells as the table has rows, blanks at both ends taken off.

    ``read_text`` gives them as Arrow text and ``read_numbers`` as numbers where every cell is a
    plain one; both keep what they have read until they are told otherwise.
    """

    def __init__(
        self,
        place: int,
        size: int,
        read_text: Callable[[int], pa.Array],
        read_numbers: Callable[[int], Floats | None],
        read_first: Callable[[int, int], pa.Array],
    ) -> None:
        self.place, self._size = place, size
        self._read_text, self._read_numbers = read_text, read_numbers
        self._read_first = read_first

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, at: int) -> str: ...
    @overload
    def __getitem__(self, at: slice) -> list[str]: ...
    def __getitem__(self, at: int | slice) -> str | list[str]:
        text = self._read_text(self.place)
        if isinstance(at, slice):
            return [cell.strip() for cell in text[at].to_pylist()]
        return str(text[at].as_py()).strip()

    def __iter__(self) -> Iterator[str]:
        for piece in self.pieces():
            yield from piece

    def first(self, count: int) -> list[str]:
        """The first cells, without reading the others."""
        return [cell.strip() for cell in self._read_first(self.place, count).to_pylist()]

    def pieces(self) -> Iterator[list[str]]:
        """The cells in order, so many at a time that they need little memory."""
        for first in range(0, self._size, _PIECE):
            yield self[first : first + _PIECE]

    def plain_numbers(self) -> Floats | None:
        """(n,) numbers where every cell is one with a decimal point; else ``None``."""
        return self._read_numbers(self.place)

    def numbers_and_rest(self, decimal: str) -> tuple[Floats, list[int], list[str]]:
        """(n,) numbers of the plain cells; the rows of all others, and their texts."""
        import pyarrow as pa
        import pyarrow.compute as pc

        text = pc.ascii_trim_whitespace(self._read_text(self.place))
        mark = r"\." if decimal == "." else ","
        pattern = rf"^-?(?:[0-9]+{mark}?[0-9]*|{mark}[0-9]+)(?:[eE][+-]?[0-9]+)?$"
        plain = pc.match_substring_regex(text, pattern)
        numbers = text.filter(plain)
        if decimal != ".":
            numbers = pc.replace_substring(numbers, ",", ".")
        is_plain = np.asarray(plain.to_numpy(zero_copy_only=False), dtype=bool)
        values = np.full(self._size, np.nan)
        values[is_plain] = pc.cast(numbers, pa.float64()).to_numpy(zero_copy_only=False)
        values[~np.isfinite(values)] = np.nan
        rest = np.flatnonzero(~is_plain)
        return values, rest.tolist(), text.take(pa.array(rest)).to_pylist()
