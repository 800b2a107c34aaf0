"""Numbers of one tag, as an archive delivers them, to a ``Column`` with a quality each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.historian.columns import Column, finished
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.connectors.historian.values.quality_codes import quality_of
from stemwatch.models.recording import Bools, Floats, Quality

_SHOWN = 30


@dataclass(frozen=True, kw_only=True)
class Codes:
    """Quality codes of n samples: ``words[index]``, (n,) indices into the distinct codes."""

    words: Sequence[str]
    index: NDArray[np.int64]
    name: str = "quality"  # of the column, for messages
    good: tuple[str, ...] = ()  # codes that the user declared good


def number_of(cell: Any) -> float:
    """The number in a cell of JSON; NaN where it is none."""
    try:
        return float(cell) if isinstance(cell, bool | int | float | str) else float("nan")
    except (ValueError, OverflowError):
        return float("nan")


def number_column(
    tag: str,
    ns: Ints,
    ok: Bools,
    values: Floats,
    *,
    source_name: str,
    unit: str = "",
    codes: Codes | None = None,
    bad: Bools | None = None,
    reasons: Mapping[str, int] | None = None,
    as_mode: bool = False,
) -> Column:
    """The column of ``tag``: (n,) ``ns`` in the source's order, ``ok`` where a time is known,
    ``values`` NaN where there is none.

    A value that is not there is MISSING, or BAD where its code says so; an infinite one is BAD;
    with ``as_mode`` anything but 0 and 1 is a CODE. ``codes`` say which values are bad, or ``bad``
    with ``reasons`` where the source's own codes are unambiguous. Raises ``UnreadableSource`` where
    codes of unknown meaning differ.
    """
    notes, reason_counts = ReadingNotes(), Counter(reasons or {})
    quality = np.where(np.isfinite(values), Quality.GOOD, Quality.MISSING).astype(np.uint8)
    infinite = np.isinf(values)
    if infinite.any():
        quality[infinite] = Quality.BAD
        reason_counts["infinite"] += int(infinite.sum())
    if as_mode:
        quality[(quality == Quality.GOOD) & (values != 0.0) & (values != 1.0)] = Quality.CODE
    if codes is not None:
        bad, code_counts = bad_by_code(codes, quality == Quality.GOOD, source_name, notes)
        reason_counts.update(code_counts)
    if bad is not None:
        quality[bad & (quality <= Quality.MISSING)] = Quality.BAD
    return finished(tag, unit, "", ns, ok, values, quality, notes=notes, reasons=reason_counts)


def bad_by_code(
    codes: Codes, has_value: Bools, source_name: str, notes: ReadingNotes
) -> tuple[Bools, Mapping[str, int]]:
    """(n,) True where the code is not good, and how often each bad code occurs."""
    count = len(codes.words)
    count_of_code = np.bincount(codes.index, minlength=count)
    with_value = np.bincount(codes.index[has_value], minlength=count) > 0
    verdict = quality_of(
        codes.words,
        with_value,
        column=codes.name,
        good=codes.good,
        name=source_name,
        notes=notes,
    )
    bad_words = verdict == Quality.BAD
    reason_of_code = {
        f"{codes.name} {word.strip()}"[:_SHOWN]: int(n)
        for word, n, bad in zip(codes.words, count_of_code, bad_words, strict=True)
        if bad and n
    }
    return np.asarray(bad_words[codes.index]), reason_of_code
