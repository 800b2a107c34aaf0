"""What was read of a plant file so far, and the small things that every part of reading needs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from stemwatch.service.plantfile.archives import ArchiveSource
from stemwatch.service.plantfile.explain import Place
from stemwatch.service.plantfile.lines import TomlLines
from stemwatch.service.plantfile.live import NotifierTable
from stemwatch.service.plantfile.problem import Problem
from stemwatch.service.plantfile.schema import Source, Valve
from stemwatch.service.store.runs.schedule import Schedule

if TYPE_CHECKING:
    from stemwatch.connectors.modbus.device import Device


@dataclass
class Found:
    """What was read so far: the good entries, where each name stands, and the problems."""

    fatal: list[Problem] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    sources: dict[str, Source] = field(default_factory=dict)
    valves: dict[str, Valve] = field(default_factory=dict)
    source_places: dict[str, Place] = field(default_factory=dict)  # of the faulty ones too
    valve_places: dict[str, Place] = field(default_factory=dict)
    orphans: dict[str, list[str]] = field(default_factory=dict)  # valves of a faulty source
    devices: dict[str, Device] = field(default_factory=dict)
    archives: dict[str, ArchiveSource] = field(default_factory=dict)
    schedules: dict[str, Schedule] = field(default_factory=dict)
    notifiers: dict[str, NotifierTable] = field(default_factory=dict)


def tables(data: dict[str, Any], key: str) -> list[tuple[int, dict[str, Any]]]:
    """The entries of ``[[key]]`` that are tables; what is not one is the top's problem."""
    entries = data.get(key)
    if not isinstance(entries, list):
        return []
    return [(i, entry) for i, entry in enumerate(entries) if isinstance(entry, dict)]


def place_of(file: str, lines: TomlLines, kind: str, position: int, name: object) -> Place:
    """Where the entry at ``position`` of ``[[kind]]`` stands, shown by its name if it has one."""
    shown = name.strip() if isinstance(name, str) and name.strip() else position + 1
    return Place(file, f"{kind}[{shown}]", lambda path: lines.of((kind, position, *path)))


def taken(key: str, name: object, place: Place, places: dict[str, Place]) -> list[Problem]:
    """The problem that ``name`` is taken, if it is; if not, it is now taken by ``place``."""
    if not isinstance(name, str) or not name.strip():
        return []  # the table's own problem
    name = name.strip()
    first = places.setdefault(name, place)
    if first is place:
        return []
    found = f"{name!r}, which {first.file}, line {first.line_of((key,))} has already"
    expected = "a name of its own (the first entry counts, this one is left out)"
    return [place.problem((key,), found, expected)]
