"""Time texts to whole numbers: day, month, year, time of day and offset of every row.

Most files write all their times in one shape. Such a column is taken apart as a matrix of
characters, all rows at once; any other is matched text by text, each distinct text once.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.historian.times.time_formats import (
    AFTERNOON,
    MONTH_NUMBER,
    MORNING,
    ZONE_MINUTES,
    match_time,
)

if TYPE_CHECKING:
    import pyarrow as pa

Ints = NDArray[np.int64]
Letters = NDArray[np.uint32] | NDArray[np.uint8]
NO_OFFSET = -100_000
_FARTHEST_MIN = 18 * 60  # of an offset; no zone is or was as far from UTC
_SECOND_NS = 1_000_000_000


class Order(IntEnum):
    """The order of the three numbers in a date."""

    UNREADABLE = 0
    YEAR_FIRST = 1  # year, month, day
    NUMERIC = 2  # two numbers whose order the file must tell, then the year


@dataclass(frozen=True)
class TimeFields:
    """(n,) each. ``first``, ``second``, ``third`` are the date's numbers as ``order`` says;
    ``day_ns`` the time of day; ``offset_min`` minutes east of UTC or ``NO_OFFSET``."""

    order: Ints
    first: Ints
    second: Ints
    third: Ints
    short_year: Ints
    dotted: Ints
    day_ns: Ints
    offset_min: Ints


def time_fields(texts: Sequence[str]) -> TimeFields:
    """Fields of every text; rows that are no time have order ``UNREADABLE``."""
    uniform = _uniform(texts)
    if uniform is not None:
        return uniform
    fields_of_text = {text: _fields_of_text(text) for text in dict.fromkeys(texts)}
    table = np.array([fields_of_text[text] for text in texts], dtype=np.int64).reshape(
        len(texts), 8
    )
    return TimeFields(*(np.ascontiguousarray(column) for column in table.T))


def stored_time_fields(text: pa.Array) -> TimeFields:
    """The same of Arrow text, blanks at both ends taken off."""
    import pyarrow.compute as pc

    text = pc.utf8_trim_whitespace(text)
    first = text[0].as_py() if len(text) else ""
    length = len(first)
    lengths = pc.min_max(pc.binary_length(text)).as_py()
    if length and first.isascii() and lengths == {"min": length, "max": length}:
        match = _match_plain(first)
        if match is not None:
            begin = text.offset * length  # trimmed text has one buffer, without gaps
            letters = np.frombuffer(text.buffers()[2], dtype=np.uint8)
            letter_fields = _of_letters(
                letters[begin : begin + len(text) * length].reshape(len(text), length), match
            )
            if letter_fields is not None:
                return letter_fields
    encoded = text.dictionary_encode()
    fields_of_each = time_fields(encoded.dictionary.to_pylist())
    rows = encoded.indices.to_numpy(zero_copy_only=False)
    return TimeFields(*(getattr(fields_of_each, name.name)[rows] for name in fields(TimeFields)))


_NOTHING = (int(Order.UNREADABLE), 0, 0, 0, 0, 0, 0, NO_OFFSET)


def _fields_of_text(text: str) -> tuple[int, ...]:
    match = match_time(text)
    if match is None:
        return _NOTHING
    clock, offset = _clock_ns(match), _offset(match)
    if clock is None or offset is None:
        return _NOTHING
    order, date, short = _date(match)
    dotted = int(match["nsep"] == ".")
    return (int(order), *date, int(short), dotted, clock, offset)


def _date(match: re.Match[str]) -> tuple[Order, tuple[int, int, int], bool]:
    for keys in (("Y", "m", "d"), ("Yj", "mj", "dj"), ("Yc", "mc", "dc")):
        if match[keys[0]] is not None:
            year, month, day = (int(match[key]) for key in keys)
            return Order.YEAR_FIRST, (year, month, day), False
    for year_key, name_key, day_key in (("yn", "mon", "dn"), ("yn2", "mon2", "dn2")):
        if match[name_key] is not None:
            month = MONTH_NUMBER[match[name_key].lower()]
            short = len(match[year_key]) == 2
            date = int(match[year_key]), month, int(match[day_key])
            return Order.YEAR_FIRST, date, short
    date = int(match["a"]), int(match["b"]), int(match["y"])
    return Order.NUMERIC, date, len(match["y"]) == 2


def _clock_ns(match: re.Match[str]) -> int | None:
    """Nanoseconds since midnight, or ``None`` for an hour that no clock shows."""
    for suffix in ("", "c", "d"):
        if match["H" + suffix] is not None:
            break
    else:
        return 0
    hour = int(match["H" + suffix])
    minute, second = int(match["M" + suffix]), int(match["S" + suffix] or 0)
    half = (match["ap1"] or match["ap2"] or "").lower()
    if half:
        if not 1 <= hour <= 12:
            return None
        hour = hour % 12 + (12 if half in AFTERNOON else 0)
        assert half in AFTERNOON or half in MORNING
    if minute > 59 or second > 59 or hour > 24 or (hour == 24 and (minute or second)):
        return None
    fraction = int((match["f"] or "0").ljust(9, "0"))
    return ((hour * 60 + minute) * 60 + second) * _SECOND_NS + fraction


def _offset(match: re.Match[str]) -> int | None:
    """Minutes east of UTC, ``NO_OFFSET`` where none is written, ``None`` for one of no zone."""
    zone = match["zone"] or match["zonec"] or match["zoned"]
    if not zone:
        return NO_OFFSET
    if zone.lower() in ZONE_MINUTES:
        return ZONE_MINUTES[zone.lower()]
    digits = zone[1:].replace(":", "").ljust(4, "0")
    minutes = int(digits[:2]) * 60 + int(digits[2:])
    if int(digits[2:]) > 59 or minutes > _FARTHEST_MIN:
        return None
    return -minutes if zone[0] == "-" else minutes


_FIELDS = ("Y", "m", "d", "a", "b", "y", "H", "M", "S", "f", "Yc", "mc", "dc", "Hc", "Mc", "Sc")


def _uniform(texts: Sequence[str]) -> TimeFields | None:
    """All texts at once where each differs from the first in digits only, else ``None``."""
    first = _match_plain(texts[0]) if len(texts) else None
    if first is None:
        return None
    length = len(texts[0])
    if any(len(text) != length for text in texts):
        return None
    letters = np.array(texts, dtype=f"U{length}").view(np.uint32).reshape(len(texts), length)
    return _of_letters(letters, first)


def _match_plain(text: str) -> re.Match[str] | None:
    """A time that is told by its digits alone."""
    first = match_time(text)
    if first is None or first.string != text or not text.isascii():
        return None
    if first["ap1"] or first["ap2"] or first["mon"] or first["mon2"] or first["Hd"]:
        return None
    return None if _offset(first) is None else first


def _of_letters(letters: Letters, first: re.Match[str]) -> TimeFields | None:
    """``letters`` (n, length): the characters of each text, which are those of ``first`` but for
    the digits; ``None`` where they are not."""
    length = letters.shape[1]
    is_digit = (letters >= ord("0")) & (letters <= ord("9"))
    in_field = np.zeros(length, dtype=bool)
    for key in _FIELDS:
        if first[key] is not None:
            in_field[slice(*first.span(key))] = True
    if not is_digit[:, in_field].all() or (letters[:, ~in_field] != letters[0, ~in_field]).any():
        return None
    return _from_matrix(letters, first)


def _from_matrix(letters: Letters, first: re.Match[str]) -> TimeFields | None:
    n = letters.shape[0]

    def number(*keys: str) -> Ints:
        for key in keys:
            if first[key] is not None:
                value = np.zeros(n, dtype=np.int64)
                for character_index in range(*first.span(key)):
                    value = value * 10 + letters[:, character_index] - ord("0")
                return value
        return np.zeros(n, dtype=np.int64)

    hour, minute, second = number("H", "Hc"), number("M", "Mc"), number("S", "Sc")
    if first["f"] is not None:
        fraction = number("f") * 10 ** (9 - len(first["f"]))
    else:
        fraction = np.zeros(n, dtype=np.int64)
    wrong = (minute > 59) | (second > 59) | (hour > 24) | ((hour == 24) & (minute + second > 0))
    numeric = first["a"] is not None
    order = np.where(wrong, Order.UNREADABLE, Order.NUMERIC if numeric else Order.YEAR_FIRST)
    return TimeFields(
        order=order.astype(np.int64),
        first=number("Y", "Yc", "a"),
        second=number("m", "mc", "b"),
        third=number("d", "dc", "y"),
        short_year=np.full(n, int(numeric and len(first["y"]) == 2)),
        dotted=np.full(n, int(first["nsep"] == ".")),
        day_ns=((hour * 60 + minute) * 60 + second) * _SECOND_NS + fraction,
        offset_min=np.full(n, _offset(first)),
    )
