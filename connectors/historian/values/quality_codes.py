"""Quality columns: which of a file's codes mean good.

OPC counts 192 and above as good and 0 as bad; the AVEVA history table counts 0 as good. A column
``Quality`` of small numbers alone is therefore never guessed: the values beside it must show the
meaning, or the user must give it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence, Set
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.values.stored_text import Kinds, coded
from stemwatch.models.recording import Bools, Quality

Family = Literal["opc", "aveva", "words", "unknown"]
_GOOD_WORDS = frozenset(
    ("good", "ok", "g", "gut", "bon", "buena", "bueno", "valid", "true", "good/modified",
     "original", "normal", "良好", "好")
)  # fmt: skip
_BAD_WORDS = frozenset(
    ("bad", "b", "uncertain", "questionable", "doubtful", "suspect", "invalid", "false",
     "schlecht", "mauvais", "mala", "substituted", "failed", "error", "timeout", "offline")
)  # fmt: skip
# What these columns are called says which of their numbers is good: a truth value, or a share in
# percent of samples that are.
_TRUE_NAMES = frozenset(("good", "valid", "validity"))
_SHARE_NAMES = frozenset(("confidence",))
_OPC_NAMES = frozenset(("qualitydetail", "opcquality", "opc_quality", "qualitycode"))
_OPC_GOOD = 0xC0
_TEXT = re.compile(r"[A-Za-z\u00c0-\u024f\u4e00-\u9fff]")


def is_good_opc(code: int) -> bool:
    """The two top bits of the OPC DA quality byte say good."""
    return code & _OPC_GOOD == _OPC_GOOD


def quality_of(
    codes: Sequence[str],
    has_value: Bools,
    *,
    column: str,
    good: Sequence[str] = (),
    family: Family = "unknown",
    name: str,
    notes: ReadingNotes,
) -> NDArray[np.uint8]:
    """(n,) GOOD or BAD for each code, and MISSING where the cell is empty beside no value.

    Raises ``UnreadableSource`` where codes of unknown meaning differ and nothing settles which of
    them is good.
    """
    distinct, code_index = coded(codes)
    verdicts = _verdicts(distinct, code_index, has_value, column, good, family, name, notes)
    qualities = [Quality.GOOD if verdicts[code] else Quality.BAD for code in distinct]
    return np.array(qualities, dtype=np.uint8)[code_index]


def _verdicts(
    distinct: list[str],
    code_index: Kinds,
    has_value: Bools,
    column: str,
    good: Sequence[str],
    family: Family,
    name: str,
    notes: ReadingNotes,
) -> Mapping[str, bool]:
    if good:
        accepted = {code.strip().lower() for code in good}
        return {code: code.lower() in accepted for code in distinct}
    numeric = {code: int(float(code)) for code in distinct if _is_number(code)}
    words = {code: _good_word(code) for code in distinct if code not in numeric}
    if not numeric:
        return words
    counts = np.bincount(code_index[has_value], minlength=len(distinct))
    with_value = {code for code, count in zip(distinct, counts.tolist(), strict=True) if count}
    return words | _numeric_verdicts(numeric, with_value, column, family, name, notes)


def _numeric_verdicts(
    numeric: dict[str, int],
    with_value: Set[str],
    column: str,
    family: Family,
    name: str,
    notes: ReadingNotes,
) -> dict[str, bool]:
    folded = column.replace(" ", "").lower()
    if family == "aveva":
        notes.decide(f"Quality column {column!r}: 0 is good (AVEVA history table).")
        return {code: value == 0 for code, value in numeric.items()}
    top = max(numeric.values())
    if family == "opc" or folded in _OPC_NAMES or _OPC_GOOD <= top <= 255:
        notes.decide(f"Quality column {column!r}: OPC codes, good from 192.")
        return {code: is_good_opc(value) for code, value in numeric.items()}
    if folded in _TRUE_NAMES and set(numeric.values()) == {0, 1}:
        notes.decide(f"Quality column {column!r}: 1 is good, 0 is not.")
        return {code: value == 1 for code, value in numeric.items()}
    if folded in _SHARE_NAMES and top == 100:
        notes.decide(f"Quality column {column!r}: 100 is good, less is not.")
        return {code: value == 100 for code, value in numeric.items()}
    if len(numeric) == 1:
        only = next(iter(numeric))
        notes.decide(
            f"Quality column {column!r} holds {only} throughout; taken as good, because it tells "
            "no row from another."
        )
        return {only: True}
    return _settled_by_values(numeric, with_value, column, name, notes)


def _settled_by_values(
    numeric: dict[str, int],
    with_value: Set[str],
    column: str,
    name: str,
    notes: ReadingNotes,
) -> dict[str, bool]:
    """Codes whose rows never have a value are bad; settled where one other code is left."""
    filled = [code for code in numeric if code in with_value]
    if len(filled) == 1:
        good = filled[0]
        notes.decide(f"Quality column {column!r}: only rows with {good} have values; it is good.")
        return {code: code == good for code in numeric}
    code_list = ", ".join(sorted(numeric, key=numeric.__getitem__)[:8])
    raise UnreadableSource(
        f"{name}: the quality column {column!r} holds the codes {code_list}; 0 means good in one "
        "system and bad in another. Say which are good with good_quality: in the plant file, such "
        f'as good_quality = ["{code_list.split(", ")[-1]}"], or in ReadOptions'
    )


def _is_number(code: str) -> bool:
    try:
        return abs(float(code)) < 2**31
    except ValueError:
        return False


def _good_word(code: str) -> bool:
    # An empty status cell does not make its value bad.
    word = code.lower().strip("'\"")
    if not word:
        return True
    if word in _BAD_WORDS or not _TEXT.search(word):
        return False
    return word in _GOOD_WORDS or word.split()[0].rstrip(",;:") in _GOOD_WORDS


def looks_like_codes(codes: Sequence[str]) -> bool:
    """Whether a column's cells are quality words or codes rather than measurements."""
    distinct = {code.strip().lower() for code in codes[:2000]} - {""}
    if not distinct or len(distinct) > 12:
        return False
    words = sum(code in _GOOD_WORDS or code in _BAD_WORDS for code in distinct)
    numbers = sum(len(code) <= 3 and code.isdecimal() and int(code) <= 255 for code in distinct)
    return words > 0 or numbers == len(distinct)
