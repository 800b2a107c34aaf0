"""Texts and numbers in the form that both SQLite and PostgreSQL accept."""

from __future__ import annotations

import math
import re

_NOT_STORABLE = re.compile("[\x00\ud800-\udfff]")


def clean_text(text: str) -> str:
    """``text`` with U+FFFD in place of NUL and lone surrogates, which databases refuse."""
    return _NOT_STORABLE.sub("\ufffd", text)


def finite(value: float | None) -> float | None:
    """``value``, or ``None`` where it is not a finite number."""
    return float(value) if value is not None and math.isfinite(value) else None
