"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Annotated
from zoneinfo import ZoneInfo

import typer

READING = "How the file is read"
PART = "Which part of the plant"
TAGS = "Which tag is what (one valve per file)"

Zone = Annotated[
    str,
    typer.Option(
        help="Time zone of times without offset, such as Europe/Berlin.",
        rich_help_panel=READING,
    ),
]
Encoding = Annotated[str, typer.Option(help="Such as cp1252.", rich_help_panel=READING)]
Separator = Annotated[
    str, typer.Option(help="The character between cells.", rich_help_panel=READING)
]
Decimal = Annotated[str, typer.Option(help="The decimal mark, . or ,", rich_help_panel=READING)]
DayFirst = Annotated[
    bool | None,
    typer.Option(
        "--day-first/--month-first",
        help="How 01/02/2026 is meant, where the file does not settle it.",
        rich_help_panel=READING,
    ),
]
TimeColumn = Annotated[
    str, typer.Option(help="Header of the time column.", rich_help_panel=READING)
]
TimeFormat = Annotated[
    str,
    typer.Option(help="Such as '%d.%m.%Y %H:%M:%S'.", rich_help_panel=READING),
]
Interval = Annotated[
    float | None,
    typer.Option(
        "--interval-s",
        help="Seconds between rows, for a file without times or with a row counter instead.",
        rich_help_panel=READING,
    ),
]
Sources = Annotated[
    list[str] | None, typer.Argument(help="Files, folders or patterns such as exports/*.csv.")
]
PlantFile = Annotated[
    Path | None, typer.Option(help="plant.toml with the valves; alone, its own sources.")
]
_SEVERAL = "may be given several times."
Site = Annotated[
    list[str] | None,
    typer.Option(help=f"Valves of this site only; {_SEVERAL}", rich_help_panel=PART),
]
Area = Annotated[
    list[str] | None,
    typer.Option(help=f"Valves of this area only; {_SEVERAL}", rich_help_panel=PART),
]
Unit = Annotated[
    list[str] | None,
    typer.Option(help=f"Valves of this unit only; {_SEVERAL}", rich_help_panel=PART),
]
OpTag = Annotated[str, typer.Option(help="Controller output.", rich_help_panel=TAGS)]
MvTag = Annotated[str, typer.Option(help="Valve position.", rich_help_panel=TAGS)]
PvTag = Annotated[str, typer.Option(help="Process variable.", rich_help_panel=TAGS)]
SpTag = Annotated[str, typer.Option(help="Set point.", rich_help_panel=TAGS)]
ModeTag = Annotated[str, typer.Option(help="Controller mode.", rich_help_panel=TAGS)]
ValveName = Annotated[
    str, typer.Option(help="The valve's name; with --plant, only this valve.", rich_help_panel=TAGS)
]
From = Annotated[str, typer.Option("--from", help="Start of the window, ISO time.")]
To = Annotated[str, typer.Option("--to", help="End of the window, ISO time.")]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes; by default one per core.")]
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write everything that was found to this file.")
]
Executor = Annotated[
    str,
    typer.Option(
        "--executor",
        metavar="WHERE",
        help="Where the work is done: local (--workers processes), in-process, or "
        "dask://HOST:PORT for the workers of a Dask scheduler.",
    ),
]
Seed = Annotated[int, typer.Option(help="The same seed gives the same result.")]


def instant(text: str, zone: str, option: str) -> datetime | None:
    """An ISO time from the command line; without an offset it is in ``zone``, else in UTC."""
    if not text:
        return None
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise typer.BadParameter(
            f"{text!r} is not a time; expected ISO form such as 2026-10-28T06:00", param_hint=option
        ) from error
    return moment if moment.tzinfo else moment.replace(tzinfo=zone_of(zone))


def zone_of(zone: str) -> ZoneInfo:
    """A time zone of the command line; UTC where it is empty. Raises ``typer.BadParameter``."""
    from stemwatch.connectors.settings import known_zone

    try:
        return ZoneInfo(known_zone(zone or "UTC"))
    except ValueError as error:
        raise typer.BadParameter(f"found {zone!r}; expected {error}", param_hint="--zone") from None


def refuse(context: typer.Context, names: Iterable[str], reason: str) -> None:
    """Raises ``typer.BadParameter`` with ``reason`` where one of the parameters ``names``, which
    would change nothing, was given."""
    for parameter in context.command.params:
        source = context.get_parameter_source(parameter.name or "")
        if parameter.name in names and source is not None and source.name != "DEFAULT":
            raise typer.BadParameter(reason, param_hint=parameter.opts[0])


def names_that_hold(
    parts: list[str] | None, names: Iterable[str], option: str, noun: str
) -> list[str]:
    """The ``names`` that contain one of ``parts``; all of them where none is given. Raises
    ``typer.BadParameter`` where no name does."""
    matching = [name for name in names if not parts or any(part in name for part in parts)]
    if not matching:
        raise typer.BadParameter(
            f"no {noun} holds {', '.join(parts or ())}; there are: {'; '.join(names)}",
            param_hint=option,
        )
    return matching


def need_file(path: Path, option: str) -> Path:
    """The path. Raises ``typer.BadParameter`` where there is no such file."""
    if not path.is_file():
        raise typer.BadParameter(f"there is no file {path}", param_hint=option)
    return path
