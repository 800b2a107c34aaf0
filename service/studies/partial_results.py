"""Intermediate results of a study that can be stopped and continued: a file of JSON objects, one a
line."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any


def append_line(file: Path | None, value: Mapping[str, object]) -> None:
    """Append ``value`` as a line to ``file``, if there is a file; times in ISO 8601."""
    if file is None:
        return
    line = json.dumps(value, default=datetime.isoformat)
    with file.open("a", encoding="utf-8") as kept:
        kept.write(line + "\n")


def stored_lines(file: Path | None) -> list[dict[str, Any]]:
    """The stored values. An incomplete last line is removed from the file, so that its value is
    computed again."""
    if file is None or not file.is_file():
        return []
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    whole = [line for line in lines if line.endswith("\n")]
    if len(whole) < len(lines):
        file.write_text("".join(whole), encoding="utf-8")
    return [json.loads(line) for line in whole]
