"""JSON of what a study counted, as it is kept beside the docs: a line for each row of a table, and
numbers to four digits, so that a change of either shows as such."""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import isfinite
from typing import Any


def by_lines(report: Mapping[str, Any]) -> str:
    """JSON with a line for each value, and for each row of a table."""
    shown = (
        "[\n" + ",\n".join(map(json.dumps, value)) + "\n]"
        if isinstance(value, list)
        else json.dumps(value)
        for value in report.values()
    )
    pairs = (f"{json.dumps(name)}: {value}" for name, value in zip(report, shown, strict=True))
    return "{\n" + ",\n".join(pairs) + "\n}\n"


def rounded(value: Any) -> Any:
    """As JSON has it: numbers to four digits, ``None`` for what is not a finite number."""
    if isinstance(value, float):
        return float(f"{value:.4g}") if isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: rounded(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [rounded(item) for item in value]
    return value
