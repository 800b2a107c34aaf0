"""``load_plant``: read ``plant.toml`` and its valve list, and report all mistakes at once.

A mistake that concerns every valve (invalid TOML, a wrong limit, an unknown table) raises
``PlantFileError``. A wrong source or valve is left out, and ``Plant.problems`` says why.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

from pydantic import BaseModel, Field, ValidationError, create_model

from stemwatch.connectors.archive.settings import ArchiveSettings
from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.historian.connector import TextExportSettings
from stemwatch.connectors.settings import Problem, SourceSettings, TomlTable, either_of, nearest
from stemwatch.models.limits import Limits
from stemwatch.service.config.plant import Plant
from stemwatch.service.config.problems import (
    PlantFileError,
    TableLocation,
    described,
    problems_of,
)
from stemwatch.service.config.schema import PlantSection, StorageSection, Valve
from stemwatch.service.config.service_schema import (
    AlertRules,
    NotifierTable,
    ScheduleTable,
    ServiceSection,
)
from stemwatch.service.config.toml import TomlLines, read_toml
from stemwatch.service.config.valve_list import read_valve_list
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.runs.schedule import ScreeningSchedule

if TYPE_CHECKING:
    from stemwatch.connectors.modbus.device import Device

# Made from ``Limits``, so that a new limit can be set in the plant file at once.
_TYPES = get_type_hints(Limits)
_FIELDS: dict[str, Any] = {
    limit.name: (_TYPES[limit.name], Field(default=limit.default, description="a number"))
    for limit in fields(Limits)
}
LimitsTable = create_model("LimitsTable", __base__=TomlTable, **_FIELDS)


class TopTable(TomlTable):
    """The whole file; limits, sources, valves and devices are validated one by one later."""

    plant: PlantSection = Field(
        default=PlantSection(), description="a table with name, site, zone and currency"
    )
    storage: StorageSection = Field(default=StorageSection(), description="a table with the url")
    limits: dict[str, Any] = Field(default={}, description="a table of limits, each a number")
    sources: list[dict[str, Any]] = Field(default=[], description="tables, each headed [[sources]]")
    valves: list[dict[str, Any]] = Field(default=[], description="tables, each headed [[valves]]")
    devices: list[dict[str, Any]] = Field(default=[], description="tables, each headed [[devices]]")
    schedules: list[dict[str, Any]] = Field(
        default=[], description="tables, each headed [[schedules]]"
    )
    notifiers: list[dict[str, Any]] = Field(
        default=[], description="tables, each headed [[notifiers]]"
    )
    alerts: AlertRules = Field(default=AlertRules(), description="a table of rules for alerts")
    service: ServiceSection = Field(
        default=ServiceSection(), description="a table of settings of the service"
    )
    valve_list: Annotated[str, Field(min_length=1)] | None = Field(
        default=None, description='the name of a CSV file, such as "valves.csv"'
    )


def read_top(data: dict[str, Any], location: TableLocation) -> tuple[TopTable, list[Problem]]:
    """The tables that concern the whole plant; with mistakes, an empty ``TopTable`` and them."""
    try:
        return TopTable.model_validate(data), []
    except ValidationError as error:
        return TopTable(), problems_of(error, TopTable, location)


def read_limits(table: Any, location: TableLocation) -> tuple[Limits, list[Problem]]:
    """The limits, with defaults for those that are not given."""
    if not isinstance(table, dict):
        return Limits(), []  # reported with the top
    try:
        limits_table = LimitsTable.model_validate(table)
        return Limits(**limits_table.model_dump()), []
    except ValidationError as error:
        return Limits(), problems_of(error, LimitsTable, location)
    except ValueError as error:
        # Raised by ``Limits``: limits that contradict one another.
        expected = str(error).removeprefix("expected ")
        return Limits(), [location.problem((), "limits that contradict one another", expected)]


@dataclass
class PlantReading:
    """The state of reading: correct entries, where each name was defined, and problems."""

    fatal: list[Problem] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    sources: dict[str, TextExportSettings] = field(default_factory=dict)
    valves: dict[str, Valve] = field(default_factory=dict)
    source_places: dict[str, TableLocation] = field(default_factory=dict)  # also of wrong sources
    valve_places: dict[str, TableLocation] = field(default_factory=dict)
    orphans: dict[str, list[str]] = field(default_factory=dict)  # valves by their wrong source
    devices: dict[str, Device] = field(default_factory=dict)
    archives: dict[str, ArchiveSettings] = field(default_factory=dict)
    schedules: dict[str, ScreeningSchedule] = field(default_factory=dict)
    notifiers: dict[str, NotifierTable] = field(default_factory=dict)


def tables(data: dict[str, Any], key: str) -> list[tuple[int, dict[str, Any]]]:
    """The entries of ``[[key]]`` that are tables; others are reported with the top table."""
    entries = data.get(key)
    if not isinstance(entries, list):
        return []
    return [(i, entry) for i, entry in enumerate(entries) if isinstance(entry, dict)]


def place_of(file: str, lines: TomlLines, kind: str, position: int, name: object) -> TableLocation:
    """The place of the entry at ``position`` of ``[[kind]]``, shown by its name if it has one."""
    label = name.strip() if isinstance(name, str) and name.strip() else position + 1
    return TableLocation(file, f"{kind}[{label}]", lambda path: lines.of((kind, position, *path)))


def name_taken(
    key: str, name: object, location: TableLocation, places: dict[str, TableLocation]
) -> list[Problem]:
    """The problem that ``name`` is taken, if it is; otherwise it is registered for ``location``."""
    if not isinstance(name, str) or not name.strip():
        return []  # reported when the table is validated
    name = name.strip()
    first = places.setdefault(name, location)
    if first is location:
        return []
    found_text = f"{name!r}, which {first.file}, line {first.line_of((key,))} has already"
    expected = "a name of its own (the first entry counts, this one is left out)"
    return [location.problem((key,), found_text, expected)]


def load_plant(path: Path | str, environment: Mapping[str, str] | None = None) -> Plant:
    """The plant that the file at ``path`` describes.

    The store's address is ``STEMWATCH_STORAGE_URL`` from ``environment`` (default: that of the
    process), else ``[storage] url``, else ``stemwatch.db`` beside the file. Raises
    ``PlantFileError`` with every mistake in the file, also those of single valves.
    """
    file = Path(path).absolute()
    data, lines = read_toml(file)
    top, top_problems = read_top(data, TableLocation(file.name, "", lines.of))
    limits_place = TableLocation(file.name, "limits", lambda path: lines.of(("limits", *path)))
    limits, limit_problems = read_limits(data.get("limits", {}), limits_place)
    reading = PlantReading(fatal=[*top_problems, *limit_problems])
    _read_sources(data, file.name, lines, reading)
    read_device_tables(data, file, lines, reading)
    _read_valves(data, file.name, lines, reading)
    _read_list(data, file, reading)
    read_live(data, file.name, lines, reading)
    _report_orphans(reading)
    _report_unknown_connections(reading)
    if reading.fatal:
        raise PlantFileError([*reading.fatal, *reading.problems])
    variables = os.environ if environment is None else environment
    return Plant(
        file=file,
        name=top.plant.name,
        currency=top.plant.currency,
        zone=top.plant.zone,
        sources=reading.sources,
        valves={
            name: valve if valve.site else valve.model_copy(update={"site": top.plant.site})
            for name, valve in reading.valves.items()
        },
        limits=limits,
        named_limits=frozenset(top.limits),
        storage=storage_address(top.storage.url, file, variables),
        problems=tuple(reading.problems),
        devices=reading.devices,
        archives=reading.archives,
        schedules=tuple(reading.schedules.values()),
        notifiers=reading.notifiers,
        alerts=top.alerts,
        service=top.service,
    )


def _read_sources(data: dict[str, Any], file: str, lines: TomlLines, reading: PlantReading) -> None:
    for position, table in tables(data, "sources"):
        name = table.get("name")
        location = place_of(file, lines, "sources", position, name)
        taken = name_taken("name", name, location, reading.source_places)
        reading.problems += taken
        model = _settings_model(table, location, reading)
        if model is None:
            continue
        try:
            source = model.model_validate(table)
        except ValidationError as error:
            reading.problems += problems_of(error, model, location)
            continue
        if taken:
            continue
        if isinstance(source, TextExportSettings):
            reading.sources[source.name] = source
        elif isinstance(source, ArchiveSettings):
            reading.archives[source.name] = source


def _settings_model(
    table: dict[str, Any], location: TableLocation, reading: PlantReading
) -> type[SourceSettings] | None:
    """The model of the table, which the connector of its kind defines; ``None`` and a problem where
    there is no such connector or it cannot be used."""
    if "kind" not in table:
        return TextExportSettings
    # Imported here, so that a plant file without archives does not load connectors.
    from stemwatch.connectors.registry import installed_connectors, settings_of

    kind = table["kind"]
    try:
        model = settings_of(kind) if isinstance(kind, str) else None
    except ConnectorError as error:
        expected = "a connector that can be used"
        reading.problems.append(location.problem(("kind",), f"{kind!r}: {error}", expected))
        return None
    if model is not None:
        return model
    kinds = installed_connectors()
    expected = either_of(kinds) + "; without kind a source is a text export"
    expected += nearest(kind, kinds) if isinstance(kind, str) else ""
    reading.problems.append(location.problem(("kind",), described(kind), expected))
    return None


def _read_valves(data: dict[str, Any], file: str, lines: TomlLines, reading: PlantReading) -> None:
    for position, table in tables(data, "valves"):
        location = place_of(file, lines, "valves", position, table.get("id"))
        _add_valve(table, location, reading, strict=True)


def _read_list(data: dict[str, Any], file: Path, reading: PlantReading) -> None:
    name = data.get("valve_list")
    if not isinstance(name, str) or not name.strip():
        return
    try:
        listing = read_valve_list(file.parent / name.strip(), shown_as=name.strip())
    except PlantFileError as error:
        reading.fatal += error.problems
        return
    reading.problems += listing.problems
    for row in listing.rows:
        _add_valve(row.table, row.location, reading, strict=False)


def _add_valve(
    table: dict[str, Any], location: TableLocation, reading: PlantReading, *, strict: bool
) -> None:
    """Add the valve if it is correct. ``strict`` is false for CSV rows, whose numbers are texts."""
    taken = name_taken("id", table.get("id"), location, reading.valve_places)
    reading.problems += taken
    context = {"sources": reading.source_places}
    try:
        valve = Valve.model_validate(table, strict=strict, context=context)
    except ValidationError as error:
        reading.problems += problems_of(error, Valve, location)
        return
    if valve.source in reading.devices:
        missing = tags_without_register(valve, reading.devices[valve.source], location)
        reading.problems += missing
        if not taken and not missing:
            reading.valves[valve.id] = valve
    elif valve.source not in reading.sources and valve.source not in reading.archives:
        reading.orphans.setdefault(valve.source, []).append(valve.id)
    elif not taken:
        reading.valves[valve.id] = valve


def _report_orphans(reading: PlantReading) -> None:
    """One problem for each wrong source, instead of one for each of its valves."""
    for source, valves in reading.orphans.items():
        valve_list = ", ".join(valves[:5]) + (", ..." if len(valves) > 5 else "")
        left_out = "its valve is" if len(valves) == 1 else f"its {len(valves)} valves are"
        problem = reading.source_places[source].problem(
            (),
            f"a source that is wrong, so {left_out} left out ({valve_list})",
            "the mistakes in this source to be corrected",
        )
        reading.problems.append(problem)


def _report_unknown_connections(reading: PlantReading) -> None:
    """Valves that ``feeds`` names and the plant does not have; the valve itself stays."""
    for valve in reading.valves.values():
        for name in valve.feeds:
            if name not in reading.valve_places:
                expected = "the id of a valve of this plant" + nearest(name, reading.valve_places)
                location = reading.valve_places[valve.id]
                found_text = f"the unknown valve {name!r}"
                reading.problems.append(location.problem(("feeds",), found_text, expected))


Read = TypeVar("Read", bound=BaseModel)


def read_device_tables(
    data: dict[str, Any], file: Path, lines: TomlLines, reading: PlantReading
) -> None:
    """Read ``[[devices]]``; their names share one namespace with sources, and their register lists
    are relative to ``file``."""
    device_tables = tables(data, "devices")
    if not device_tables:
        return
    # Imported here, so that pymodbus is loaded only where a plant has devices.
    from stemwatch.connectors.modbus.read_devices import read_devices

    good = []
    for position, table in device_tables:
        name = table.get("name")
        location = place_of(file.name, lines, "devices", position, name)
        taken = name_taken("name", name, location, reading.source_places)
        reading.problems += taken
        if not taken:
            good.append((position, table))
    for position, table in good:
        read = read_devices(
            [table],
            lambda path, index=position: lines.of((path[0], index, *path[2:])),  # type: ignore[misc]
            file.name,
            folder=file.parent,
        )
        reading.devices |= {device.name: device for device in read.devices}
        reading.problems += read.problems


def read_live(data: dict[str, Any], file: str, lines: TomlLines, reading: PlantReading) -> None:
    """Read schedules and notifiers; a wrong one is left out."""
    places: dict[str, TableLocation] = {}
    for position, table in tables(data, "schedules"):
        location = place_of(file, lines, "schedules", position, table.get("name"))
        if read := _named(ScheduleTable, table, location, places, reading):
            reading.schedules[read.name] = read.schedule()
            reading.problems += _unknown_valves(read, location, reading)
    places = {}
    for position, table in tables(data, "notifiers"):
        location = place_of(file, lines, "notifiers", position, table.get("name"))
        if notifier := _named(NotifierTable, table, location, places, reading):
            reading.notifiers[notifier.name] = notifier


def _unknown_valves(
    read: ScheduleTable, location: TableLocation, reading: PlantReading
) -> list[Problem]:
    """Problems for valves, areas and units of a schedule that the plant does not have."""
    valves = reading.valves.values()
    known = {
        "valves": set(reading.valves),
        "areas": {valve.area for valve in valves},
        "units": {valve.unit for valve in valves},
    }
    return [
        location.problem((key,), f"the unknown {key[:-1]} {name!r}", "one that this file describes")
        for key, known_names in known.items()
        for name in getattr(read, key)
        if name not in known_names
    ]


def _named(
    model: type[Read],
    table: dict[str, Any],
    location: TableLocation,
    places: dict[str, TableLocation],
    reading: PlantReading,
) -> Read | None:
    """``table`` as ``model`` if it is correct and its name is not taken."""
    taken = name_taken("name", table.get("name"), location, places)
    reading.problems += taken
    try:
        read = model.model_validate(table)
    except ValidationError as error:
        reading.problems += problems_of(error, model, location)
        return None
    return None if taken else read


def tags_without_register(valve: Valve, device: Device, location: TableLocation) -> list[Problem]:
    """Problems for tags of a valve that no register of its device has."""
    mapped = set(device.tags)
    return [
        location.problem(
            ("tags", role.value, "tag"),
            f"{tag.tag!r}, which no register of {device.name} has",
            "the tag of one of its registers" + nearest(tag.tag, mapped),
        )
        for role, tag in valve.tags.by_role().items()
        if tag.tag not in mapped
    ]


VARIABLE = "STEMWATCH_STORAGE_URL"
DEFAULT_NAME = "stemwatch.db"
_SQLITE_FILE = "sqlite:///"


def storage_address(url: str | None, plant_file: Path, variables: Mapping[str, str]) -> DatabaseUrl:
    """The address from the environment, else the file's ``url``, else a database beside the file.

    A relative SQLite path is relative to the plant file, so that commands find the same store from
    every folder.
    """
    chosen = variables.get(VARIABLE, "").strip() or url or f"{_SQLITE_FILE}{DEFAULT_NAME}"
    name = chosen.removeprefix(_SQLITE_FILE)
    if name in (chosen, "", ":memory:") or name.startswith("file:"):
        return DatabaseUrl(chosen)
    return DatabaseUrl(f"{_SQLITE_FILE}{plant_file.parent / name}")
