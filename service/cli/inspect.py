"""``stemwatch inspect``: what is understood of an export, and the tags of archives."""

from __future__ import annotations

import fnmatch
import json
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o
from stemwatch.service.cli.reading import given_by, read_options

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from stemwatch.connectors.archive.settings import ArchiveSettings
    from stemwatch.connectors.connector import TagInfo
    from stemwatch.connectors.historian import HistorianFile, Inspection, ReadOptions
    from stemwatch.connectors.historian.proposed_plant import ProposedSource, ProposedTag
    from stemwatch.service.config import Plant

_ROLES = ("op", "mv", "pv", "sp", "mode")
_SHOWN = 40  # valves on the terminal
_of_archives = partial(typer.Option, rich_help_panel="Archives of a plant file")


@given_by(read_options, name="options")
def inspect(
    file: Annotated[
        Path,
        typer.Argument(
            help="A CSV or text export of a historian, a folder of exports, or a plant file whose "
            "archives are looked through."
        ),
    ],
    json_file: o.JsonFile = None,
    write: Annotated[
        Path | None,
        typer.Option(help="Write the proposed plant file here, unless it is there already."),
    ] = None,
    source: Annotated[str, _of_archives(help="Only this source of the plant file.")] = "",
    pattern: Annotated[
        str,
        _of_archives(
            help="Only tags whose name fits, such as 'FIC*'; capital letters do not matter."
        ),
    ] = "",
    *,
    options: ReadOptions,
) -> None:
    """Show what is understood of an export, and propose a mapping for plant.toml.

    It prints encoding, separator, decimal mark, layout, time zone, every tag with unit and role,
    sampling interval and jitter, bad values, gaps, and signs of compression, quantisation and
    frozen signals. A tag named MV may be the controller output or the valve position: it is never
    guessed. If OP strokes a valve by a curve, as in a split range, the curve is proposed as well.

    Given a plant file, it lists the tags of its archives (PI, InfluxDB, OPC UA, SQL, Parquet) and
    proposes valves by their names.
    """
    if not file.is_dir():
        o.need_file(file, "FILE")
    if write is not None and write.exists():
        raise typer.BadParameter(
            f"{write} exists and is not overwritten; name another file", param_hint="--write"
        )
    if file.suffix == ".toml":
        _inspect_archives(file, source, pattern, write, json_file)
        return
    if source or pattern:
        raise typer.BadParameter(
            f"--source and --pattern are for archives; {file} is not a plant file (.toml)",
            param_hint="FILE",
        )
    _inspect_exports(file, options, write, json_file)


def _inspect_exports(
    file: Path, options: ReadOptions, write: Path | None, json_file: Path | None
) -> None:
    """Print, and write, what is understood of an export or of a folder of them."""

    from stemwatch.connectors.historian.proposed_plant import plant_toml
    from stemwatch.service.cli import inspection_views, views

    files = _files_of(file, options)
    seen = [(source.path, source.inspect()) for source in files]
    _show([inspection for _, inspection in seen])
    if json_file is not None:
        inspections = [inspection.to_dict() for _, inspection in seen]
        views.write_json(
            json_file, inspections if file.is_dir() else inspections[0], allow_nan=True
        )
    sources = _sources(file, seen, write, options)
    proposed = plant_toml(sources, _curves(files))
    if write is not None:
        views.write_file(write, proposed)
        inspection_views.say_plant_written(write)
        return
    inspection_views.show_proposal(proposed)
    views.say_next(
        "keep it with --write plant.toml, or screen the file itself: stemwatch screen FILE"
    )


def _files_of(file: Path, options: ReadOptions) -> list[HistorianFile]:
    """The export, or the exports of the folder; those that are no recording are said and left out.

    Raises ``ConnectorError`` for a folder without a recording.
    """
    from rich.markup import escape

    from stemwatch.connectors.connector import ConnectorError
    from stemwatch.connectors.historian import HistorianFile, find_sources
    from stemwatch.service.cli import views

    if not file.is_dir():
        return [HistorianFile(file, options)]
    sources = find_sources([file])
    if not sources.paths:
        reasons = "; ".join(f"{path}: {reason}" for path, reason in sources.skipped)
        raise ConnectorError(reasons or f"there is no recording in {file}")
    for path, reason in sources.skipped:
        views.say(f"{escape(str(path))}: {escape(reason)}")
    return [HistorianFile(path, options) for path in sources.paths]


def _show(inspections: Sequence[Inspection]) -> None:
    """Print the facts of each file, and its tags unless an earlier file has the same ones."""
    from stemwatch.service.cli import inspection_views, views

    shown_tags: set[frozenset[str]] = set()
    for inspection in inspections:
        names = frozenset(tag.tag for tag in inspection.tags)
        facts, tags = inspection_views.inspection_tables(inspection)
        views.out.print(facts)
        if names in shown_tags:
            continue
        shown_tags.add(names)
        views.out.print(tags)
        for line in inspection_views.inspection_remarks(inspection):
            views.out.print(line, highlight=False)


def _sources(
    file: Path,
    seen: Sequence[tuple[Path, Inspection]],
    write: Path | None,
    options: ReadOptions,
) -> list[ProposedSource]:
    """What the plant file has as sources, with paths as ``write`` must give them, where relative
    paths count from it, and with the options that at least one file needed."""
    import glob

    from stemwatch.connectors.historian.options import given_options
    from stemwatch.connectors.historian.proposed_plant import ProposedSource, sources_of

    unused = frozenset.intersection(*(inspection.unused_options for _, inspection in seen))
    options_given = {
        name: value for name, value in given_options(options).items() if name not in unused
    }
    if file.is_dir():
        relative = [(_seen_from(write, path), inspection) for path, inspection in seen]
        return sources_of(relative, _seen_from(write, file), options_given)
    path = glob.escape(_seen_from(write, file).as_posix())
    return [ProposedSource("historian", path, (seen[0][1],), options_given)]


def _seen_from(plant_file: Path | None, export: Path) -> Path:
    """The path of ``export`` as ``plant_file`` must give it; unchanged without a plant file."""
    if plant_file is None:
        return export
    folder, export = plant_file.resolve().parent, export.resolve()
    return export.relative_to(folder) if export.is_relative_to(folder) else export


def _curves(files: Sequence[HistorianFile]) -> dict[str, str]:
    """The lines that give the curves from OP to stroke, for valves whose position is certain; of a
    valve in several files by the first that shows one."""
    curves: dict[str, str] = {}
    for source in files:
        curves = _curves_in(source) | curves
    return curves


def _curves_in(source: HistorianFile) -> dict[str, str]:
    from stemwatch.connectors.connector import ConnectorError
    from stemwatch.connectors.historian import propose_valves
    from stemwatch.models.recording import Role

    measured = [valve for valve in propose_valves(source) if Role.MV in valve.tags]
    if not measured:
        return {}
    from stemwatch.models.limits import Limits
    from stemwatch.models.preparation.own_clock import on_own_clock  # with what is compiled
    from stemwatch.models.record_checks.quality import assess
    from stemwatch.models.stickslip.find_stroke_curve import find_stroke_curve
    from stemwatch.models.stickslip.stored_range import in_percent

    curves = {}
    for valve in measured:
        try:
            # A position in mA is no curve; a screening reads it in percent as well.
            assessment = assess(on_own_clock(in_percent(source.read(valve))), Limits())
        except ConnectorError:
            continue  # screening the valve says why
        curve = None if assessment.obstacles else find_stroke_curve(assessment.recording)
        if curve is not None and curve.proposal():
            curves[valve.valve] = curve.proposal()
    return curves


def _inspect_archives(
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
    from stemwatch.models.words import counted
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
        number = f"{counted(len(tags), 'tag')}, {counted(len(valves), 'valve')}"
        views.say_result(f"{name}: {number} by their names")
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
    # A node id of OPC UA begins with its namespace and may be a number: its names count as well.
    fits = [
        info
        for info in infos
        if any(
            fnmatch.fnmatchcase(name.lower(), (pattern or "*").lower())
            for name in (info.tag, info.description, info.proposed_valve)
        )
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
