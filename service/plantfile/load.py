"""``load_plant``: read ``plant.toml`` and its valve list, and say everything that is wrong at once.

What is wrong for every valve (TOML that cannot be read, a wrong limit, an unknown table) makes the
file unusable: ``PlantFileError``. What is wrong with one source or one valve costs that one only:
it is left out, and ``Plant.problems`` says why.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from stemwatch.service.plantfile.explain import Place, problems_of
from stemwatch.service.plantfile.found import Found, place_of, tables, taken
from stemwatch.service.plantfile.lines import TomlLines
from stemwatch.service.plantfile.load_archives import read_archive
from stemwatch.service.plantfile.load_live import not_in_map, read_device_tables, read_live
from stemwatch.service.plantfile.plant import Plant
from stemwatch.service.plantfile.problem import PlantFileError
from stemwatch.service.plantfile.schema import Source, Valve
from stemwatch.service.plantfile.storage import storage_address
from stemwatch.service.plantfile.toml import read_toml
from stemwatch.service.plantfile.top import read_limits, read_top
from stemwatch.service.plantfile.valve_list import read_valve_list


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
    found = Found(fatal=[*top_problems, *limit_problems])
    _read_sources(data, file.name, lines, found)
    read_device_tables(data, file, lines, found)
    _read_valves(data, file.name, lines, found)
    _read_list(data, file, found)
    read_live(data, file.name, lines, found)
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
        devices=found.devices,
        archives=found.archives,
        schedules=tuple(found.schedules.values()),
        notifiers=found.notifiers,
        alerts=top.alerts,
        service=top.service,
    )


def _read_sources(data: dict[str, Any], file: str, lines: TomlLines, found: Found) -> None:
    for position, table in tables(data, "sources"):
        name = table.get("name")
        place = place_of(file, lines, "sources", position, name)
        again = taken("name", name, place, found.source_places)
        found.problems += again
        if "kind" in table:
            read_archive(table, place, found, known=not again)
            continue
        try:
            source = Source.model_validate(table)
        except ValidationError as error:
            found.problems += problems_of(error, Source, place)
            continue
        if not again:
            found.sources[source.name] = source


def _read_valves(data: dict[str, Any], file: str, lines: TomlLines, found: Found) -> None:
    for position, table in tables(data, "valves"):
        place = place_of(file, lines, "valves", position, table.get("id"))
        _add_valve(table, place, found, strict=True)


def _read_list(data: dict[str, Any], file: Path, found: Found) -> None:
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


def _add_valve(table: dict[str, Any], place: Place, found: Found, *, strict: bool) -> None:
    """Keep the valve if nothing is wrong with it. ``strict`` is false for a CSV row, whose
    numbers are texts."""
    again = taken("id", table.get("id"), place, found.valve_places)
    found.problems += again
    context = {"sources": found.source_places}
    try:
        valve = Valve.model_validate(table, strict=strict, context=context)
    except ValidationError as error:
        found.problems += problems_of(error, Valve, place)
        return
    if valve.source in found.devices:
        missing = not_in_map(valve, found.devices[valve.source], place)
        found.problems += missing
        if not again and not missing:
            found.valves[valve.id] = valve
    elif valve.source not in found.sources and valve.source not in found.archives:
        found.orphans.setdefault(valve.source, []).append(valve.id)
    elif not again:
        found.valves[valve.id] = valve


def _report_orphans(found: Found) -> None:
    """One sentence for each faulty source, not one for each of its thousands of valves."""
    for source, valves in found.orphans.items():
        shown = ", ".join(valves[:5]) + (", ..." if len(valves) > 5 else "")
        problem = found.source_places[source].problem(
            (),
            f"a source that is wrong, so its {len(valves)} valves are left out ({shown})",
            "the mistakes in this source to be mended",
        )
        found.problems.append(problem)
