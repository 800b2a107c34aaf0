"""The archives of a plant file as ``stemwatch inspect`` shows them: tags found, valves proposed."""

from __future__ import annotations

import fnmatch
import json
from dataclasses import asdict
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from stemwatch.connectors.archive.settings import ArchiveSettings
    from stemwatch.connectors.connector import TagInfo
    from stemwatch.connectors.historian.proposed_plant import ProposedTag
    from stemwatch.service.config import Plant

_ROLES = ("op", "mv", "pv", "sp", "mode")
_SHOWN = 40  # valves on the terminal


def inspect_archives(
    file: Path, source: str, pattern: str, write: Path | None, json_file: Path | None
) -> None:
    """List the tags of the archives of a plant file and propose its valves.

    What is written is the plant file with the valves after it, beside it, because its paths count
    from there. Raises ``typer.BadParameter`` where that is not so, and for a file without archives.
    """
    from stemwatch.connectors.historian.proposed_plant import (
        ProposedTag,
        questions_toml,
        valves_of,
        valves_toml,
    )
    from stemwatch.service.cli import inspection_views, views
    from stemwatch.service.config import load_plant

    if write is not None and write.resolve().parent != file.resolve().parent:
        raise typer.BadParameter(
            f"paths in {file} count from its folder; name a file beside it", param_hint="--write"
        )
    plant = load_plant(file)
    for problem in plant.problems:
        views.say_error(str(problem))
    tags_of_source = {
        name: _tags_of(settings, plant, file, pattern)
        for name, settings in _chosen(plant, file, source).items()
    }
    known = set(plant.valves)
    lines: list[str] = []
    found: set[str] = set()
    for name, infos in tags_of_source.items():
        tags = [ProposedTag.listed(info) for info in infos]
        valves = valves_of(tags)
        views.say_result(f"{name}: {len(tags)} tags, {len(valves)} valves by their names")
        _show_valves(tags, valves)
        lines += [*valves_toml(tags, name, known), *questions_toml(tags)]
        found |= set(valves)
        known |= found
    if json_file is not None:
        objects = {name: [asdict(info) for info in infos] for name, infos in tags_of_source.items()}
        views.write_file(json_file, json.dumps(objects, indent=1, default=str) + "\n")
    if not any(line.startswith("[[valves]]") for line in lines):
        views.say(
            f"No new valve is proposed: {file} has all of these."
            if found
            else "No new valve is proposed: no tag is certain to be a controller output (.OP, "
            ".OUT, .CO and the like). Try another --pattern, or name the tags in a valve list."
        )
    if write is None and not any(lines):
        if found:
            views.say_next(f"stemwatch screen --plant {file}")
        return
    proposed = "\n".join(lines[1:] if lines[:1] == [""] else lines) + "\n"
    if write is None:
        inspection_views.show_proposal(proposed)
        views.say_next(f"add this to {file}, or keep it with --write plant.toml")
        return
    whole = file.read_text(encoding="utf-8-sig").rstrip() + "\n\n" + proposed
    views.write_file(write, whole)
    inspection_views.say_plant_written(write)


def _chosen(plant: Plant, file: Path, source: str) -> Mapping[str, ArchiveSettings]:
    archives = plant.archives
    if source and source not in archives:
        names = ", ".join(map(repr, archives)) or "none"
        raise typer.BadParameter(
            f"{file} has no archive {source!r}; its archives are {names}", param_hint="--source"
        )
    if not archives:
        raise typer.BadParameter(
            f'{file} names no archive; expected a [[sources]] table with kind = "pi" or another '
            "(docs/archives.md)",
            param_hint="FILE",
        )
    return {source: archives[source]} if source else archives


def _tags_of(
    settings: ArchiveSettings, plant: Plant, file: Path, pattern: str
) -> Sequence[TagInfo]:
    """The tags that fit, in the order of their names; an archive that can look for them itself is
    asked for no others."""
    if pattern and "pattern" in type(settings).model_fields:
        settings = settings.model_copy(update={"pattern": pattern})
    infos = settings.address(file.resolve().parent, plant.zone).open().tags()
    fits = [
        info for info in infos if fnmatch.fnmatchcase(info.tag.lower(), (pattern or "*").lower())
    ]
    return sorted(fits, key=lambda info: info.tag)


def _show_valves(tags: Sequence[ProposedTag], valves: Sequence[str]) -> None:
    from stemwatch.service.cli import views
    from stemwatch.service.cli.views import plain_table

    if not valves:
        return
    by_role = {(tag.valve, tag.role): tag.tag for tag in tags if tag.role}
    table = plain_table("", ("valve", *_ROLES), ())
    for valve in valves[:_SHOWN]:
        table.add_row(*map(views.escape, (valve, *(by_role.get((valve, r), "") for r in _ROLES))))
    views.out.print(table)
    if len(valves) > _SHOWN:
        views.say_result(f"and {len(valves) - _SHOWN} more")
