"""``load_plant``: read ``plant.toml`` and its valve list, and say everything that is wrong at once.

What is wrong for every valve (TOML that cannot be read, a wrong limit, an unknown table) makes the
file unusable: ``PlantFileError``. What is wrong with one source or one valve costs that one only:
it is left out, and ``Plant.problems`` says why.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from stemwatch.service.plantfile.explain import Place, problems_of
from stemwatch.service.plantfile.lines import TomlLines
from stemwatch.service.plantfile.plant import Plant
from stemwatch.service.plantfile.problem import PlantFileError, Problem
from stemwatch.service.plantfile.schema import Source, Valve
from stemwatch.service.plantfile.storage import storage_address
from stemwatch.service.plantfile.toml import read_toml
from stemwatch.service.plantfile.top import read_limits, read_top
from stemwatch.service.plantfile.valve_list import read_valve_list


@dataclass
class _Found:
    """What was read so far: the good entries, where each name stands, and the problems."""

    fatal: list[Problem] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    sources: dict[str, Source] = field(default_factory=dict)
    valves: dict[str, Valve] = field(default_factory=dict)
    source_places: dict[str, Place] = field(default_factory=dict)  # of the faulty ones too
    valve_places: dict[str, Place] = field(default_factory=dict)
    orphans: dict[str, list[str]] = field(default_factory=dict)  # valves of a faulty source


def load_plant(path: Path | str, environment: Mapping[str, str] | None = None) -> Plant:
    """The plant that the file at ``path`` describes.

    The store's address is ``STEMWATCH_STORAGE_URL`` from ``environment`` (default: the
    process's), else ``[storage] url``, else ``stemwatch.db`` beside the file. Raises
    ``PlantFileError`` with every mistake found, including those that alone would only have cost
    one valve.
    """
    file = Path(path).absolute()
    data, lines = read_toml(file)
    top, top_problems = read_top(data, Place(file.name, "", lines.of))
    limits_place = Place(file.name, "limits", lambda path: lines.of(("limits", *path)))
    limits, limit_problems = read_limits(data.get("limits", {}), limits_place)
    found = _Found(fatal=[*top_problems, *limit_problems])
    _read_sources(data, file.name, lines, found)
    _read_valves(data, file.name, lines, found)
    _read_list(data, file, found)
    _report_orphans(found)
    if found.fatal:
        raise PlantFileError([*found.fatal, *found.problems])
    variables = os.environ if environment is None else environment
    return Plant(
        file=file,
        name=top.plant.name,
        zone=top.plant.zone,
        sources=found.sources,
        valves=found.valves,
        limits=limits,
        storage=storage_address(top.storage.url, file, variables),
        problems=tuple(found.problems),
    )


def _tables(data: dict[str, Any], key: str) -> list[tuple[int, dict[str, Any]]]:
    """The entries of ``[[key]]`` that are tables; what is not one is the top's problem."""
    entries = data.get(key)
    if not isinstance(entries, list):
        return []
    return [(i, entry) for i, entry in enumerate(entries) if isinstance(entry, dict)]


def _place(file: str, lines: TomlLines, kind: str, position: int, name: object) -> Place:
    shown = name.strip() if isinstance(name, str) and name.strip() else position + 1
    return Place(file, f"{kind}[{shown}]", lambda path: lines.of((kind, position, *path)))


def _again(key: str, name: object, place: Place, places: dict[str, Place]) -> list[Problem]:
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


def _read_sources(data: dict[str, Any], file: str, lines: TomlLines, found: _Found) -> None:
    for position, table in _tables(data, "sources"):
        name = table.get("name")
        place = _place(file, lines, "sources", position, name)
        again = _again("name", name, place, found.source_places)
        found.problems += again
        try:
            source = Source.model_validate(table)
        except ValidationError as error:
            found.problems += problems_of(error, Source, place)
            continue
        if not again:
            found.sources[source.name] = source


def _read_valves(data: dict[str, Any], file: str, lines: TomlLines, found: _Found) -> None:
    for position, table in _tables(data, "valves"):
        place = _place(file, lines, "valves", position, table.get("id"))
        _add_valve(table, place, found, strict=True)


def _read_list(data: dict[str, Any], file: Path, found: _Found) -> None:
    name = data.get("valve_list")
    if not isinstance(name, str) or not name.strip():
        return
    try:
        listed = read_valve_list(file.parent / name.strip(), shown_as=name.strip())
    except PlantFileError as error:
        found.fatal += error.problems
        return
    found.problems += listed.problems
    for row in listed.rows:
        _add_valve(row.table, row.place, found, strict=False)


def _add_valve(table: dict[str, Any], place: Place, found: _Found, *, strict: bool) -> None:
    """Keep the valve if nothing is wrong with it. ``strict`` is false for a CSV row, whose
    numbers are texts."""
    again = _again("id", table.get("id"), place, found.valve_places)
    found.problems += again
    context = {"sources": found.source_places}
    try:
        valve = Valve.model_validate(table, strict=strict, context=context)
    except ValidationError as error:
        found.problems += problems_of(error, Valve, place)
        return
    if valve.source not in found.sources:
        found.orphans.setdefault(valve.source, []).append(valve.id)
    elif not again:
        found.valves[valve.id] = valve


def _report_orphans(found: _Found) -> None:
    """One sentence for each faulty source, not one for each of its thousands of valves."""
    for source, valves in found.orphans.items():
        shown = ", ".join(valves[:5]) + (", ..." if len(valves) > 5 else "")
        problem = found.source_places[source].problem(
            (),
            f"a source that is wrong, so its {len(valves)} valves are left out ({shown})",
            "the mistakes in this source to be mended",
        )
        found.problems.append(problem)
