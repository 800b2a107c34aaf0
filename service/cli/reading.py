"""From command-line options to the ``Request`` of a run: reading options, plant, tags, window."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import typer

from stemwatch.connectors.historian import ReadOptions
from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from stemwatch.models.recording import Role
    from stemwatch.service.config import Plant
    from stemwatch.service.run.plan import Request


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
    """The reading options; an empty text means "decide from the file"."""
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


def request_of(
    sources: Sequence[str] | None,
    plant: Path | None,
    tags: dict[Role, str],
    valve: str,
    from_: str,
    to: str,
    options: ReadOptions,
) -> Request:
    """The request of a command; window times without offset are in the zone of the options, else
    in that of the plant, else in UTC."""
    from stemwatch.service.run.plan import Request

    loaded = loaded_plant(plant, sources)
    zone = options.zone or (loaded.zone if loaded else None) or ""
    return Request(
        sources=tuple(sources or ()),
        plant=loaded,
        tags=tags,
        valve=valve,
        window=window_of(from_, to, zone),
        read_options=options,
    )


def loaded_plant(plant: Path | None, source: Sequence[str] | None) -> Plant | None:
    """The plant file, or ``None`` where only sources are given; neither is wrong usage."""
    from stemwatch.service.config import load_plant

    if plant is None:
        if not source:
            raise typer.BadParameter("give a file, a folder or --plant plant.toml")
        return None
    return load_plant(o.need_file(plant, "--plant"))


def tags_of(**named: str):  # type: ignore[no-untyped-def]  # Role is imported late, with numpy
    """The given tags by role; without OP the usage is wrong."""
    from stemwatch.models.recording import Role

    tags = {Role(name): tag for name, tag in named.items() if tag}
    if tags and Role.OP not in tags:
        raise typer.BadParameter(
            "the controller output is needed: --op TAG (`stemwatch inspect` lists the tags)",
            param_hint="--op",
        )
    return tags


def window_of(from_: str, to: str, zone: str):  # type: ignore[no-untyped-def]
    """The window between two times; one that ends before it begins is wrong usage."""
    from stemwatch.connectors.connector import Window

    start, stop = o.instant(from_, zone, "--from"), o.instant(to, zone, "--to")
    if start is not None and stop is not None and start >= stop:
        raise typer.BadParameter(f"--from {start} is not before --to {stop}", param_hint="--from")
    return Window(start=start, stop=stop)
