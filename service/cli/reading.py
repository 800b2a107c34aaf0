"""From command-line texts to ``ReadOptions``."""

from __future__ import annotations

from typing import Any

import typer

from stemwatch.connectors.historian import ReadOptions


def read_options(
    zone: str,
    encoding: str,
    separator: str,
    decimal: str,
    day_first: bool | None,
    time_column: str,
    time_format: str,
    interval_s: float | None,
) -> ReadOptions:
    """The options a user gave; an empty text means "decide from the file"."""
    named: dict[str, Any] = {
        "zone": zone,
        "encoding": encoding,
        "separator": {"tab": "\t", "\\t": "\t"}.get(separator, separator),
        "decimal": decimal,
        "time_column": time_column,
        "time_format": time_format,
    }
    given = {name: value for name, value in named.items() if value}
    try:
        return ReadOptions(day_first=day_first, interval_s=interval_s, **given)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
