"""The decimal mark of a file: a point or a comma, decided from every cell of its value columns."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.values.numbers import (
    EXPONENT,
    LONGEST,
    SIGN,
    quick_numbers,
    written_with,
)
from stemwatch.connectors.historian.values.stored_text import Rows, StoredText
from stemwatch.models.recording import Bools

if TYPE_CHECKING:
    import pyarrow as pa

_FIRST = 500  # cells of a column that show whether it holds numbers with a point
_LONGEST_PLAIN = 100  # characters; a number with no more is finite and needs no check
_ASKED = 8  # columns of a large file whose first cells are checked before all are read
_AT_ONCE = 8_000_000  # cells whose texts are compared at one time
# A comma that is not followed by exactly three digits cannot be a thousands separator.
_CERTAIN_COMMA = re.compile(r",(?:[0-9]{1,2}(?![0-9])|[0-9]{4})")
_VOTES = {
    "either": "^[+-]?[1-9][0-9]{0,2},[0-9]{3}$",
    "comma": "^[+-]?(?:[0-9]{1,15},(?:[0-9]{1,2}|[0-9]{4,15})"
    "|(?:0[0-9]{0,2}|[0-9]{4,15}),[0-9]{3})$",
    "whole": "^[+-]?[0-9]{1,15}$",
}
_COMMA_NUMBER = re.compile(rf"{SIGN}[0-9][0-9.,' \u00a0\u202f]*{EXPONENT}")


def decide_decimal(columns: Iterable[Sequence[str]], separator: str, name: str) -> tuple[str, str]:
    """Decimal mark of a file and the sentence why, from every cell of its value columns.

    ``1,5`` and ``0,123`` can only be decimal commas, ``1.5`` only a decimal point; ``1,234``
    alone is either. Raises ``UnreadableSource`` where only such numbers occur and the separator
    does not settle it.
    """
    all_columns = list(columns)
    stored = [cells for cells in all_columns if isinstance(cells, StoredText)]
    votes = stored_votes(stored) if stored else _votes(all_columns)
    comma, point, either = votes["comma"], votes["point"], votes["either"]
    if comma or point:
        if comma > point:
            return ",", f"The decimal mark is a comma ({comma} numbers show it)."
        return ".", "The decimal mark is a point."
    if not either:
        return ".", "No number has a decimal mark; a point is taken."
    if separator == ";":
        return ",", "Numbers like 1,234 in a file with semicolons were read as 1.234."
    if separator == "," and votes["whole"]:  # thousands go with numbers below a thousand
        return ".", "Numbers like '1,234' in quotes were read as 1234 (thousands)."
    either = _votes_of_texts(stored)["either"] if stored else either
    raise UnreadableSource(
        f"{name}: {either} numbers such as '1,234' may be 1.234 or 1234, and no other number "
        "settles it; say decimal=',' or decimal='.' (--decimal on the command line)"
    )


def _votes(columns: Iterable[Sequence[str]]) -> Counter[str]:
    votes: Counter[str] = Counter()
    for cells in columns:
        joined = "\n".join(cells)
        if "," not in joined:
            are_numbers = quick_numbers(cells[:_FIRST], ".") is not None
            votes["point" if "." in joined else "whole"] += are_numbers
            continue
        certain = len(_CERTAIN_COMMA.findall(joined))
        if certain and quick_numbers(cells, ",") is not None:
            votes["comma"] += certain
            continue
        for text in dict.fromkeys(cells):
            votes[_vote(text.strip())] += 1
    return votes


def _vote(text: str) -> str:
    if len(text) > LONGEST or not _COMMA_NUMBER.fullmatch(text):
        return "none"
    as_point, as_comma = written_with(text, "."), written_with(text, ",")
    if as_point and as_comma:
        if "," in text and text.lstrip("+-").startswith("0"):
            return "comma"
        return "either" if "," in text else "whole"
    if as_comma:
        return "comma"
    return "point" if as_point else "none"


def stored_votes(columns: Sequence[StoredText]) -> Counter[str]:
    """What ``_votes`` counts, of columns that stay in their file."""
    import pyarrow as pa

    votes: Counter[str] = Counter()
    if not columns:
        return votes
    file = columns[0].columns
    if not file.has_comma and (not file.has_point or _shows_point(columns[:_ASKED])):
        votes["point"] += file.has_point
        return votes
    doubtful = []
    for cells, seen in zip(columns, _look_at(columns), strict=True):
        if not seen.comma:
            are_numbers = quick_numbers(seen.first[:_FIRST], ".") is not None
            votes["point" if seen.point else "whole"] += are_numbers
        elif seen.certain and seen.numbers:
            votes["comma"] += seen.certain
        elif seen.texts is not None:
            votes["either"] += seen.either
            if seen.texts:
                votes += _distinct_votes(pa.concat_arrays(seen.texts).unique())
        else:
            doubtful.append(cells)
    return votes + _votes_of_texts(doubtful)


def _votes_of_texts(columns: Sequence[StoredText]) -> Counter[str]:
    """The votes of the different cells of these columns."""
    votes: Counter[str] = Counter()
    at_once = max(1, _AT_ONCE // max(1, len(columns[0]))) if columns else 1
    for begin in range(0, len(columns), at_once):
        part = columns[begin : begin + at_once]
        part[0].columns.read([], part, ".")
        for cells in part:
            votes += _distinct_votes(cells.whole().unique())
            cells.forget()
    return votes


def _shows_point(columns: Sequence[StoredText]) -> bool:
    for cells in columns:
        first = cells.first(_FIRST)
        if any("." in cell for cell in first) and quick_numbers(first, ".") is not None:
            return True
    return False


def _distinct_votes(texts: pa.Array) -> Counter[str]:
    import pyarrow.compute as pc

    votes: Counter[str] = Counter()
    # What ``_vote`` says of nearly all cells, told at once.
    for vote, pattern in _VOTES.items():
        told = pc.match_substring_regex(texts, pattern)
        votes[vote] += pc.sum(told).as_py() or 0
        texts = texts.filter(pc.invert(told))
    for text in texts.to_pylist():
        votes[_vote(text.strip())] += 1
    return votes


@dataclass
class _Seen:
    """The evidence of the marks in a column."""

    comma: bool = False
    point: bool = False
    certain: int = 0  # commas that cannot mark thousands
    numbers: bool = True  # every cell is one with a decimal comma or none
    first: list[str] = field(default_factory=list)
    either: bool = False  # a comma that may mark thousands or decimals
    texts: list[pa.Array] | None = None  # others that are in doubt, the different ones of a batch


@dataclass(frozen=True)
class _Marks:
    """(n,) each: what ``_Seen`` counts, of some cells."""

    comma: Bools
    point: Bools
    certain: NDArray[np.int64]
    numbers: Bools
    either: Bools | None = None  # told where each cell is digits around one comma

    def of(self, rows: Rows) -> _Marks:
        """The marks of the cells ``rows`` alone."""
        either = None if self.either is None else self.either[rows]
        return _Marks(
            self.comma[rows], self.point[rows], self.certain[rows], self.numbers[rows], either
        )


def _look_at(columns: Sequence[StoredText]) -> list[_Seen]:
    """One pass over the file."""
    cells_in_all = sum(len(cells) for cells in columns)
    seen = [_Seen(texts=[] if cells_in_all <= _AT_ONCE else None) for _ in columns]
    places = sorted({column_index for cells in columns for column_index in cells.places})
    rows_seen = 0
    for batch in columns[0].columns.batches(places):
        by_place = dict(zip(places, batch, strict=True))
        marks_by_text: dict[object, tuple[pa.Array, _Marks]] = {}
        for cells, votes in zip(columns, seen, strict=True):
            key = (cells.places, cells.combine)
            if key not in marks_by_text:
                text = cells.of([by_place[column_index] for column_index in cells.places])
                marks_by_text[key] = (text, _marks(text))
            _add(votes, cells, *marks_by_text[key], rows_seen)
        rows_seen += len(batch[0])
    return seen


def _add(votes: _Seen, cells: StoredText, text: pa.Array, marks: _Marks, rows_before: int) -> None:
    import pyarrow as pa

    if cells.rows is not None:
        begin, end = np.searchsorted(cells.rows, (rows_before, rows_before + len(text)))
        if begin == end:
            return
        rows = cells.rows[begin:end] - rows_before
        marks = marks.of(rows)
        if len(votes.first) < _FIRST or votes.texts is not None:
            text = text.take(pa.array(rows))
    votes.comma = votes.comma or bool(marks.comma.any())
    votes.point = votes.point or bool(marks.point.any())
    votes.certain += int(marks.certain.sum())
    votes.numbers = votes.numbers and bool(marks.numbers.all())
    if len(votes.first) < _FIRST:
        votes.first += text[:_FIRST].to_pylist()
    if votes.certain and votes.numbers:
        votes.texts = None  # its commas were counted
    if votes.texts is None:
        return
    if marks.either is not None:
        votes.either = votes.either or bool(marks.either.any())
        text = text.filter(pa.array(~marks.either))
    if len(text):
        votes.texts.append(text.unique())


def _marks(text: pa.Array) -> _Marks:
    import pyarrow as pa
    import pyarrow.compute as pc

    plain = _plain_marks(text)
    if plain is not None:
        return plain
    comma = _bools(pc.match_substring(text, ","))
    point = _bools(pc.match_substring(text, "."))
    certain = np.zeros(len(text), dtype=np.int64)
    if not comma.any():
        return _Marks(comma, point, certain, ~point & _numbers(text))
    try:
        if point.any():
            raise pa.ArrowInvalid("a point beside commas")
        values = pc.cast(pc.replace_substring(text, ",", "."), pa.float64())
        exponent = pc.any(pc.match_substring_regex(text, "[eE]")).as_py()
        if exponent or not np.isfinite(values.to_numpy(zero_copy_only=False)).all():
            raise pa.ArrowInvalid("not plain numbers")
    except pa.ArrowInvalid:
        comma_counts = (
            len(_CERTAIN_COMMA.findall(cell)) for cell in text.filter(comma).to_pylist()
        )
        certain[comma] = np.fromiter(comma_counts, dtype=np.int64, count=int(comma.sum()))
        return _Marks(comma, point, certain, ~point & _numbers(text))
    comma_position = pc.find_substring(text, ",").to_numpy(zero_copy_only=False)
    digits = pc.binary_length(text).to_numpy(zero_copy_only=False) - comma_position - 1
    certain = (comma & (digits != 3) & (digits > 0)).astype(np.int64)
    return _Marks(comma, point, certain, np.ones(len(text), dtype=bool))


def _plain_marks(text: pa.Array) -> _Marks | None:
    """The same of cells that hold digits, at most one comma and a sign before them, and nothing
    else, from their bytes at once; ``None`` of any others."""
    count = len(text)
    begins = np.frombuffer(text.buffers()[1], dtype=np.int32)[text.offset :][: count + 1]
    lengths = np.diff(begins)
    if not count or lengths.max() > _LONGEST_PLAIN:
        return None
    signs = np.frombuffer(text.buffers()[2], dtype=np.uint8)[begins[0] : begins[-1]]
    at = np.flatnonzero((signs < ord("0")) | (signs > ord("9")))
    others = signs[at]
    is_comma = others == ord(",")
    if not (is_comma | (others == ord("-")) | (others == ord("+"))).all():
        return None
    starts, ends = begins[:-1] - begins[0], begins[1:] - begins[0]
    if at.size == count and is_comma.all() and ((at >= starts) & (at < ends)).all():
        whole, digits = at - starts, ends - at - 1
        either = (digits == 3) & (whole >= 1) & (whole <= 3) & (signs[starts] != ord("0"))
        certain = ((digits != 3) & (digits > 0)).astype(np.int64)
        every = np.ones(count, dtype=bool)
        return _Marks(every, ~every, certain, every, either) if lengths.min() > 1 else None
    cell = np.searchsorted(ends, at, side="right")
    if not (is_comma | (at == begins[cell] - begins[0])).all():
        return None  # a sign amid the digits
    commas = np.bincount(cell[is_comma], minlength=count)
    if commas.max() > 1 or (lengths - np.bincount(cell, minlength=count) < 1).any():
        return None  # two commas, or no digit
    digits = np.zeros(count, dtype=np.int64)
    with_comma = cell[is_comma]
    digits[with_comma] = (begins[with_comma + 1] - begins[0]) - at[is_comma] - 1
    has_comma = commas > 0
    certain = (has_comma & (digits != 3) & (digits > 0)).astype(np.int64)
    return _Marks(has_comma, np.zeros(count, dtype=bool), certain, np.ones(count, dtype=bool))


def _numbers(text: pa.Array) -> Bools:
    """(n,) whether ``quick_numbers`` takes the cell for a number with a decimal comma."""
    import pyarrow.compute as pc

    pattern = r"^\s*[+-]?(?:[0-9]+,?[0-9]*|,[0-9]+)(?:[eE][+-]?[0-9]+)?\s*$"
    numbers = _bools(pc.match_substring_regex(text, pattern))
    large = _bools(pc.match_substring_regex(text, "[eE]|[0-9]{200}")) & numbers
    for row in np.flatnonzero(large).tolist():
        numbers[row] = np.isfinite(float(text[row].as_py().replace(",", ".")))
    return numbers


def _bools(flags: pa.Array) -> Bools:
    return np.array(flags.to_numpy(zero_copy_only=False), dtype=bool)
