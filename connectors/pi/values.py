"""Values as the PI Web API writes them, to the column of one tag."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from stemwatch.connectors.archive.number_column import number_column, number_of
from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.historian.columns import Column, convert
from stemwatch.connectors.historian.raw_table import RawColumn
from stemwatch.connectors.historian.times.instants import Instants
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.models.recording import Bools

ZONE = "The server gives instants in UTC."
QUESTIONABLE, SUBSTITUTED, NOT_GOOD = "Questionable", "Substituted", "not good"


def column_of(
    tag: str,
    values: Sequence[Mapping[str, Any]],
    *,
    unit: str,
    source_name: str,
    good: Collection[str],
    as_mode: bool,
) -> Column:
    """The column of ``tag`` from recorded values, in their order.

    A value that is not good, questionable or substituted is BAD, unless ``good`` holds that word.
    A value that is an object is a digital state and no number: a system state (``I/O Timeout``)
    is BAD by its name, any other is a word, as in a text export.
    """
    ns = _instants(values, source_name)
    bad, reasons = _bad(values, good)
    cells = [value.get("Value") for value in values]
    words = [_state(cell) for cell in cells]
    if as_mode or any(word and not hidden for word, hidden in zip(words, bad, strict=True)):
        return _text_column(
            tag, cells, ns, bad, unit=unit, source_name=source_name, as_mode=as_mode
        )
    return number_column(
        tag,
        ns,
        np.ones(ns.size, dtype=bool),
        np.array([number_of(cell) for cell in cells], dtype=np.float64),
        source_name=source_name,
        unit=unit,
        bad=bad,
        reasons=reasons,
        as_mode=as_mode,
    )


def _instants(values: Sequence[Mapping[str, Any]], source_name: str) -> Ints:
    """(n,) nanoseconds; the server writes UTC with up to seven decimals and a Z."""
    texts = [str(value.get("Timestamp", "")) for value in values]
    try:
        if not all(text.endswith("Z") for text in texts):
            raise ValueError
        return np.array([text[:-1] for text in texts], dtype="datetime64[ns]").astype(np.int64)
    except ValueError:
        wrong = next((text for text in texts if not _readable(text)), "")
        raise ConnectorError(
            f"{source_name}: found the time {wrong!r}; expected one such as "
            "2026-01-05T06:00:00.25Z, in UTC"
        ) from None


def _readable(text: str) -> bool:
    try:
        np.datetime64(text.removesuffix("Z"), "ns")
    except ValueError:
        return False
    return text.endswith("Z")


def _bad(
    values: Sequence[Mapping[str, Any]], good: Collection[str]
) -> tuple[Bools, Mapping[str, int]]:
    """(n,) True where a value must not be used, and the count of each reason."""
    reasons: Counter[str] = Counter()
    bad = np.zeros(len(values), dtype=bool)
    for index, value in enumerate(values):
        if reason := _why_bad(value, good):
            bad[index] = True
            reasons[reason] += 1
    return bad, reasons


def _why_bad(value: Mapping[str, Any], good: Collection[str]) -> str:
    cell = value.get("Value")
    if value.get("Errors") or (isinstance(cell, dict) and cell.get("Errors")):
        return "error"
    if isinstance(cell, dict) and (cell.get("IsSystem") or not value.get("Good", True)):
        return str(cell.get("Name", "system state"))[:30]
    if not value.get("Good", True):
        return NOT_GOOD
    for word in (QUESTIONABLE, SUBSTITUTED):
        if value.get(word) and word not in good:
            return word
    return ""


def _state(cell: Any) -> str:
    """The name of a digital state, or a text that is no number; else nothing."""
    if isinstance(cell, dict):
        return str(cell.get("Name", "")) or "state"
    if isinstance(cell, str):
        return "" if np.isfinite(number_of(cell)) else cell
    return ""


def _text_column(
    tag: str,
    cells: Sequence[Any],
    ns: Ints,
    bad: Bools,
    *,
    unit: str,
    source_name: str,
    as_mode: bool,
) -> Column:
    """States and numbers together, read by the rules of a text export; bad ones as ``Bad``."""
    texts = [
        "Bad" if hidden else _state(cell) or ("" if cell is None else repr(number_of(cell)))
        for cell, hidden in zip(cells, bad.tolist(), strict=True)
    ]
    raw = RawColumn(tag=tag, cells=texts, unit=unit, quality_codes=None)
    ok = np.ones(ns.size, dtype=bool)
    instants = Instants(ns=ns, ok=ok, in_utc=True, zone=ZONE)
    return convert(raw, instants, decimal=".", good=(), name=source_name, as_mode=as_mode)
