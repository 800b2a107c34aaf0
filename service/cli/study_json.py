"""JSON of what a study counted, as it is kept beside the docs: a line for each row of a table, and
numbers to four digits, so that a change of either shows as such."""

from __future__ import annotations

import json
from collections.abc import Mapping
from math import isfinite
from typing import Any


def study_json(report: Mapping[str, Any]) -> str:
    """JSON with a line for each value, and for each row of a table."""
    values = {name: _rounded(value) for name, value in report.items()}
    pairs = (f"{json.dumps(name)}: {_lines(value)}" for name, value in values.items())
    return "{\n" + ",\n".join(pairs) + "\n}\n"


def _lines(value: Any) -> str:
    if isinstance(value, list):
        return "[\n" + ",\n".join(map(json.dumps, value)) + "\n]"
    return json.dumps(value)


def _rounded(value: Any) -> Any:
    """As JSON has it: numbers to four digits, ``None`` for what is not a finite number."""
    if isinstance(value, float):
        return float(f"{value:.4g}") if isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: _rounded(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    return value
