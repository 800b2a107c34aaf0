"""The options that several commands share, made into what they mean: how files are read, and the
``Request`` of a run."""

# Typer evaluates the annotations, so this module has no ``from __future__ import annotations``;
# types that are slow to import are quoted.
import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, get_type_hints

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from stemwatch.connectors.connector import Window
    from stemwatch.connectors.historian import ReadOptions
    from stemwatch.models.recording import Provenance, Role
    from stemwatch.service.config import Plant
    from stemwatch.service.plant_path import PartOfPlant
    from stemwatch.service.run.plan import Request

Command = Callable[..., Any]
MOST_FILES_SAID = 5  # on the terminal


def given_by(make: Callable[..., Any], *, name: str) -> Callable[[Command], Command]:
    """A decorator for commands: the argument ``name`` is replaced on the command line by the
    arguments of ``make``, and gets what ``make`` returns for them."""
    shared = inspect.signature(make).parameters

    def with_options(command: Command) -> Command:
        own_parameters = inspect.signature(command).parameters
        seen = {
            option: parameter.annotation
            for option, parameter in own_parameters.items()
            if option != name
        }
        hints = get_type_hints(
            SimpleNamespace(__annotations__=seen), command.__globals__, include_extras=True
        )
        options: list[inspect.Parameter] = []
        for option, parameter in own_parameters.items():
            options += shared.values() if option == name else [parameter]

        @wraps(command)
        def run(**arguments: Any) -> Any:
            made = make(**{option: arguments.pop(option) for option in shared})
            return command(**{name: made}, **arguments)

        run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
            [
                option.replace(
                    kind=inspect.Parameter.KEYWORD_ONLY,
                    annotation=hints.get(option.name, option.annotation),
                )
                for option in options
            ]
        )
        run.__annotations__ = {}
        return run

    return with_options


def read_options(
    zone: o.Zone = "",
    encoding: o.Encoding = "",
    separator: o.Separator = "",
    decimal: o.Decimal = "",
    day_first: o.DayFirst = None,
    time_column: o.TimeColumn = "",
    time_format: o.TimeFormat = "",
    interval_s: o.Interval = None,
) -> "ReadOptions":
    """The reading options; an empty text means "decide from the file"."""
    from stemwatch.connectors.historian import ReadOptions

    named: dict[str, Any] = {
        "zone": zone,
        "encoding": encoding,
        "separator": {"tab": "\t", "\\t": "\t"}.get(separator, separator),
        "decimal": decimal,
        "time_column": time_column,
        "time_format": time_format,
    }
    arguments = {name: value for name, value in named.items() if value}
    try:
        return ReadOptions(day_first=day_first, interval_s=interval_s, **arguments)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error


@dataclass(frozen=True, kw_only=True)
class RecordingOptions:
    """The options of a command that reads recordings, apart from its sources."""

    plant: Path | None
    tags: "dict[Role, str]"
    valve: str
    start: str
    stop: str
    read_options: "ReadOptions"

    def request(self, sources: Sequence[str] | None) -> "Request":
        """The request for these sources."""
        return request_of(
            sources, self.plant, self.tags, self.valve, self.start, self.stop, self.read_options
        )


@given_by(read_options, name="options")
def recording_options(
    plant: o.PlantFile = None,
    op: o.OpTag = "",
    mv: o.MvTag = "",
    pv: o.PvTag = "",
    sp: o.SpTag = "",
    mode: o.ModeTag = "",
    valve: o.ValveName = "",
    from_: o.From = "",
    to: o.To = "",
    *,
    options: "ReadOptions",
) -> RecordingOptions:
    """The shared options of a command that reads recordings, as one value."""
    return RecordingOptions(
        plant=plant,
        tags=tags_of(op=op, mv=mv, pv=pv, sp=sp, mode=mode),
        valve=valve,
        start=from_,
        stop=to,
        read_options=options,
    )


@given_by(recording_options, name="recording")
def requested(source: o.Sources = None, *, recording: RecordingOptions) -> "Request":
    """The request of a command that reads recordings."""
    return recording.request(source)


def request_of(
    sources: Sequence[str] | None,
    plant: Path | None,
    tags: "dict[Role, str]",
    valve: str,
    from_: str,
    to: str,
    options: "ReadOptions",
) -> "Request":
    """The request of a command; window times without offset are in the zone of the options, else
    in that of the plant, else in UTC. ``valve`` names that of ``tags``, or one of the plant."""
    from stemwatch.connectors.connector import nearest_names
    from stemwatch.service.run.plan import Request

    _refuse_what_nobody_asks_for(sources, plant, tags, valve, (from_, to), options)
    loaded = loaded_plant(plant, sources)
    if loaded is not None and valve and valve not in loaded.valves:
        raise typer.BadParameter(
            f"there is no valve {valve!r} among the {len(loaded.valves)} of {plant}; nearest: "
            f"{nearest_names(valve, list(loaded.valves)) or 'none'}",
            param_hint="--valve",
        )
    zone = options.zone or (loaded.zone if loaded else None) or ""
    return Request(
        sources=tuple(sources or ()),
        plant=loaded,
        tags=tags,
        valve=valve,
        valves=(valve,) if loaded is not None and valve else (),
        window=window_of(from_, to, zone),
        read_options=options,
    )


def _refuse_what_nobody_asks_for(
    sources: Sequence[str] | None,
    plant: Path | None,
    tags: "dict[Role, str]",
    valve: str,
    window: tuple[str, str],
    options: "ReadOptions",
) -> None:
    """Wrong usage where an option would make no difference whatever the files hold."""
    from stemwatch.connectors.historian.options import given_options

    if plant is not None and tags:
        option = f"--{next(iter(tags))}"
        raise typer.BadParameter(
            f"{option} is for files without a plant file; {plant} says which tag is what",
            param_hint=option,
        )
    if valve and not tags and plant is None:
        raise typer.BadParameter(
            "--valve names the valve whose tags are given; give its --op as well",
            param_hint="--valve",
        )
    if plant is None or sources:
        return  # options that a file does not need are reported with what was read
    option_names = set(given_options(options)) - ({"zone"} if any(window) else set())
    if option_names:
        option = "--" + min(option_names).replace("_", "-")
        raise typer.BadParameter(
            f"{option} says how the files on the command line are read, and there are none; for "
            f"the plant's own sources say it in [[sources]] of {plant}",
            param_hint=option,
        )


def say_reading_remarks(recordings: "Iterable[Provenance]") -> None:
    """On the terminal: the options of the command line that made no difference to a file, and
    which tag may be a position that nobody named."""
    from stemwatch.service.cli import views

    said = {
        (Path(provenance.source).name, sentence): None
        for provenance in recordings
        for sentence in (*provenance.unused_options, provenance.position_question)
        if sentence
    }
    remarks = list(said)
    for source, sentence in remarks[:MOST_FILES_SAID]:
        views.say(f"{source}: {sentence}")
    if len(remarks) > MOST_FILES_SAID:
        views.say(f"and so in {len(remarks) - MOST_FILES_SAID} more; the report names each")


def loaded_plant(plant: Path | None, source: Sequence[str] | None) -> "Plant | None":
    """The plant file, or ``None`` where only sources are given; neither is wrong usage."""
    from stemwatch.service.config import load_plant

    if plant is None:
        if not source:
            raise typer.BadParameter("give a file, a folder or --plant plant.toml")
        return None
    return load_plant(o.need_file(plant, "--plant"))


def part_of(
    site: Sequence[str] | None, area: Sequence[str] | None, unit: Sequence[str] | None
) -> "PartOfPlant":
    """The part of the plant that the options name."""
    from stemwatch.service.plant_path import PartOfPlant

    return PartOfPlant(sites=tuple(site or ()), areas=tuple(area or ()), units=tuple(unit or ()))


def valves_in_part(plant: "Plant | None", part: "PartOfPlant") -> tuple[str, ...]:
    """The valves of a part of the plant, none where the whole is meant. A part that the plant file
    does not have, or one without a plant file, is wrong usage."""
    from stemwatch.service.plant_path import UnknownPart

    if not part:
        return ()
    option = f"--{next(iter(part.asked))}"
    if plant is None:
        raise typer.BadParameter(
            f"{option} needs --plant plant.toml, which says where each valve is", param_hint=option
        )
    try:
        return tuple(valve.id for valve in part.valves(plant.valves.values()))
    except UnknownPart as error:
        raise typer.BadParameter(f"{plant.file.name}: {error}", param_hint=option) from None


def tags_of(**named: str) -> "dict[Role, str]":
    """The given tags by role; without OP the usage is wrong."""
    from stemwatch.models.recording import Role

    tags = {Role(name): tag for name, tag in named.items() if tag}
    if tags and Role.OP not in tags:
        raise typer.BadParameter(
            "the controller output is needed: --op TAG (`stemwatch inspect` lists the tags)",
            param_hint="--op",
        )
    return tags


def window_of(from_: str, to: str, zone: str) -> "Window":
    """The window between two times; one that ends before it begins is wrong usage."""
    from stemwatch.connectors.connector import Window

    start, stop = o.instant(from_, zone, "--from"), o.instant(to, zone, "--to")
    if start is not None and stop is not None and start >= stop:
        raise typer.BadParameter(f"--from {start} is not before --to {stop}", param_hint="--from")
    return Window(start=start, stop=stop)
