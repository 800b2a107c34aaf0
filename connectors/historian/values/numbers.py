"""Cells to numbers: exact, never guessed, one decimal mark per file.

Python's own ``float`` is exact and, over a whole column at once, as quick as any vectorised
parser; what it also accepts beyond plain decimal numbers (``1_000``, digits of other scripts,
``inf``) is refused here, so that a number in a recording is always one that stands in the file.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from stemwatch.connectors.historian.values.stored_text import StoredText
from stemwatch.connectors.historian.values.units import is_unit
from stemwatch.models.recording import Floats

LONGEST = 400  # characters; longer cells are no numbers
SIGN = r"[+\-\u2212]?"
EXPONENT = r"(?:[eE][+\-]?[0-9]+)?"
_PLAIN = {
    ".": re.compile(rf"{SIGN}(?:[0-9]+\.?[0-9]*|\.[0-9]+){EXPONENT}"),
    ",": re.compile(rf"{SIGN}(?:[0-9]+,?[0-9]*|,[0-9]+){EXPONENT}"),
}
_GROUPED = {
    ".": re.compile(
        rf"{SIGN}[0-9]{{1,3}}(?:(?:,[0-9]{{3}})+|(?:[ '\u00a0\u202f][0-9]{{3}})+)(?:\.[0-9]+)?"
    ),
    ",": re.compile(
        rf"{SIGN}[0-9]{{1,3}}(?:(?:\.[0-9]{{3}})+|(?:[ '\u00a0\u202f][0-9]{{3}})+)(?:,[0-9]+)?"
    ),
}
_MARKS = re.compile(r"[ '\u00a0\u202f]")
_GROUPS = re.compile(r"[0-9][,. '\u00a0\u202f][0-9]{3}(?![0-9])")
_FEWEST_APART, _HABIT = 2, 0.1  # cells with marks for thousands, and their share of all
# "1000" is often written without a separator, "10000" rarely.
_NEEDS_MARK, _NEAR_MARK = 10_000.0, 500.0
_WITH_UNIT = re.compile(r"^(?P<number>[^A-Za-z%°]*[0-9.,])\s*(?P<unit>[A-Za-z%°][^\s]*)$")


def written_with(text: str, decimal: str) -> bool:
    """Whether ``text`` is a number with this decimal mark, marks for thousands or none."""
    return bool(_PLAIN[decimal].fullmatch(text) or _GROUPED[decimal].fullmatch(text))


def parse_number(text: str, decimal: str) -> float | None:
    """The number that ``text`` is, or ``None``. ``decimal`` is the file's decimal mark."""
    text = text.strip()
    if len(text) > LONGEST:
        return None
    if _PLAIN[decimal].fullmatch(text):
        return float(text.replace(decimal, ".").replace("\u2212", "-"))
    if _GROUPED[decimal].fullmatch(text):
        other = "," if decimal == "." else "."
        digits = _MARKS.sub("", text).replace(other, "")
        return float(digits.replace(decimal, ".").replace("\u2212", "-"))
    with_unit = _WITH_UNIT.match(text)
    if with_unit and is_unit(with_unit["unit"]):
        return parse_number(with_unit["number"], decimal)
    return None


def parse_numbers(cells: Sequence[str], decimal: str) -> Floats:
    """(n,) numbers of ``cells``; NaN where a cell is none (or is too large for a float), and where
    its marks for thousands are not what the other cells write."""
    if isinstance(cells, StoredText):
        return _of_stored(cells, decimal)
    quick = quick_numbers(cells, decimal)
    if quick is not None:
        return quick
    number_of_text: dict[str, float] = {}
    doubtful: set[str] = set()
    for text in dict.fromkeys(cells):
        number = parse_number(text, decimal)
        number_of_text[text] = np.nan if number is None else number
        if number is not None and _may_be_two(text, decimal):
            doubtful.add(text)
    if doubtful and not _writes_thousands_apart(cells, number_of_text, doubtful):
        number_of_text.update(dict.fromkeys(doubtful, np.nan))
    values = np.fromiter(
        (number_of_text[text] for text in cells), dtype=np.float64, count=len(cells)
    )
    values[~np.isfinite(values)] = np.nan
    return values


def _of_stored(cells: StoredText, decimal: str) -> Floats:
    """The same numbers, plain cells read as such by Arrow, which is as exact."""
    quick = cells.plain_numbers(decimal)
    if quick is not None:
        return quick
    values, rows, texts = cells.numbers_and_rest(decimal)
    distinct = dict.fromkeys(texts)
    numbers = (text for text in distinct if parse_number(text, decimal) is not None)
    if any(_may_be_two(text, decimal) for text in numbers):
        return parse_numbers(list(cells), decimal)
    if rows:
        values[rows] = parse_numbers(texts, decimal)
    return values


def _may_be_two(text: str, decimal: str) -> bool:
    """Whether a mark for thousands in ``text`` may as well be another sign that was damaged.

    ``41 435`` may be two numbers or 41.435; ``41.435,2`` has both marks and is one number.
    """
    text = text.strip()
    if _PLAIN[decimal].fullmatch(text) or not _GROUPS.search(text):
        return False
    return bool(_MARKS.search(text)) or decimal not in text


def _writes_thousands_apart(
    cells: Sequence[str], number_of_text: dict[str, float], doubtful: set[str]
) -> bool:
    """Whether the column has the habit: several of its numbers are written so, none of five
    digits is not, and they are a tenth of all or go on from where the plain ones end."""
    count = Counter(cells)
    doubtful_count = sum(count[text] for text in doubtful)
    certain_numbers = [
        abs(v) for text, v in number_of_text.items() if np.isfinite(v) and text not in doubtful
    ]
    largest = max(certain_numbers, default=0.0)
    if doubtful_count < _FEWEST_APART or largest >= _NEEDS_MARK:
        return False
    numbers = sum(n for text, n in count.items() if np.isfinite(number_of_text[text]))
    return doubtful_count >= _HABIT * numbers or largest >= _NEAR_MARK


def quick_numbers(cells: Sequence[str], decimal: str) -> Floats | None:
    """All cells at once, or ``None`` where a cell needs a closer look."""
    joined = "\n".join(cells)
    if not joined.isascii() or "_" in joined:
        return None
    if decimal == ",":
        if "." in joined or joined.count("\n") != max(0, len(cells) - 1):
            return None
        cells = joined.replace(",", ".").split("\n")
    try:
        values = np.fromiter(map(float, cells), dtype=np.float64, count=len(cells))
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None
