"""Reading the tables of the service: devices, schedules, notifiers. One that is wrong costs itself
only."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from pydantic import BaseModel, ValidationError

from stemwatch.service.plantfile.explain import Place, problems_of
from stemwatch.service.plantfile.found import Found, place_of, tables, taken
from stemwatch.service.plantfile.lines import TomlLines
from stemwatch.service.plantfile.live import NotifierTable, ScheduleTable
from stemwatch.service.plantfile.nearest import nearest
from stemwatch.service.plantfile.problem import Problem
from stemwatch.service.plantfile.schema import Valve

if TYPE_CHECKING:
    from stemwatch.connectors.modbus.device import Device

Read = TypeVar("Read", bound=BaseModel)


def read_device_tables(data: dict[str, Any], file: Path, lines: TomlLines, found: Found) -> None:
    """The ``[[devices]]``; their names are those of sources, their lists lie beside ``file``."""
    listed = tables(data, "devices")
    if not listed:
        return
    # Late: pymodbus is loaded where a plant has devices, and nowhere else.
    from stemwatch.connectors.modbus.config import read_devices

    good = []
    for position, table in listed:
        name = table.get("name")
        place = place_of(file.name, lines, "devices", position, name)
        again = taken("name", name, place, found.source_places)
        found.problems += again
        if not again:
            good.append((position, table))
    for position, table in good:
        read = read_devices(
            [table],
            lambda path, at=position: lines.of((path[0], at, *path[2:])),  # type: ignore[misc]
            file.name,
            folder=file.parent,
        )
        found.devices |= {device.name: device for device in read.devices}
        found.problems += [
            Problem(
                file=one.file, line=one.line, key=one.key, found=one.found, expected=one.expected
            )
            for one in read.problems
        ]


def read_live(data: dict[str, Any], file: str, lines: TomlLines, found: Found) -> None:
    """Schedules and notifiers; one that is wrong costs itself only."""
    places: dict[str, Place] = {}
    for position, table in tables(data, "schedules"):
        place = place_of(file, lines, "schedules", position, table.get("name"))
        if read := _named(ScheduleTable, table, place, places, found):
            found.schedules[read.name] = read.schedule()
            found.problems += _unknown_valves(read, place, found)
    places = {}
    for position, table in tables(data, "notifiers"):
        place = place_of(file, lines, "notifiers", position, table.get("name"))
        if notifier := _named(NotifierTable, table, place, places, found):
            found.notifiers[notifier.name] = notifier


def _unknown_valves(read: ScheduleTable, place: Place, found: Found) -> list[Problem]:
    """What a schedule names and the plant does not have; the rest of it holds."""
    areas = {valve.area for valve in found.valves.values()}
    asked = [("valves", name, found.valves) for name in read.valves]
    asked += [("areas", name, areas) for name in read.areas]  # type: ignore[misc]
    return [
        place.problem((key,), f"the unknown {key[:-1]} {name!r}", "one that this file describes")
        for key, name, known in asked
        if name not in known
    ]


def _named(
    model: type[Read], table: dict[str, Any], place: Place, places: dict[str, Place], found: Found
) -> Read | None:
    """``table`` as ``model`` if nothing is wrong with it and its name is its own."""
    again = taken("name", table.get("name"), place, places)
    found.problems += again
    try:
        read = model.model_validate(table)
    except ValidationError as error:
        found.problems += problems_of(error, model, place)
        return None
    return None if again else read


def not_in_map(valve: Valve, device: Device, place: Place) -> list[Problem]:
    """Tags of a valve that its device has no register for."""
    known = set(device.tags)
    return [
        place.problem(
            ("tags", role.value, "tag"),
            f"{tag.tag!r}, which no register of {device.name} has",
            "the tag of one of its registers" + nearest(tag.tag, known),
        )
        for role, tag in valve.tags.given().items()
        if tag.tag not in known
    ]
