"""From what a user typed to tasks: which files, which valves in each, which tags."""

from __future__ import annotations

import os
import re
import threading
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path

from stemwatch.connectors.connector import (
    WHOLE,
    ConnectorError,
    TagMapping,
    ValveTags,
    Window,
)
from stemwatch.connectors.historian import ReadOptions, find_sources, propose_valves
from stemwatch.connectors.parquet import ParquetAddress, split_archives
from stemwatch.models.recording import Role
from stemwatch.service.config import Plant
from stemwatch.service.executors import Executor, outcomes
from stemwatch.service.run.task import (
    InStore,
    Task,
    TextFile,
    open_archive,
    open_file,
    tags_of_files,
)

MOST_NAMED = 12  # tags of a file that are listed
NO_VALVE = (
    "no controller output was recognised in this file; say which tags are meant with --op and "
    "--mv, or in a plant.toml (`stemwatch inspect` shows the tags)."
)

Looked = frozenset[str] | str  # the tags in a file, or why it cannot be read
Look = Callable[[Sequence[TextFile]], Sequence[Looked]]
HEAD_BYTES = 1_000_000
LINES = 12
_SEPARATORS = re.compile(r"[,;\t|]")
_UNIT = re.compile(r"\s*[\[(][^\[\]()]*[\])]$")
# A row of a narrow export names one tag; a header of a wide one names several.
FEWEST = 2


@dataclass(frozen=True, kw_only=True)
class Request:
    """What to screen: sources, and either a plant or tags or neither (then valves are proposed).

    Without sources those of the plant, of its ``valves`` or of all where none are named.
    ``live_window`` is for valves whose samples are in the store; without one ``window`` is.
    """

    sources: Sequence[str] = ()
    plant: Plant | None = None
    tags: dict[Role, str] = field(default_factory=dict)
    valve: str = ""
    valves: tuple[str, ...] = ()
    window: Window = WHOLE
    live_window: Window | None = None
    read_options: ReadOptions = field(default_factory=ReadOptions)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Tasks in order, and (source, reason) for what is no recording at all."""

    tasks: tuple[Task, ...]
    not_read: tuple[tuple[str, str], ...] = ()


def look_here(files: Sequence[TextFile]) -> Sequence[Looked]:
    """Parse the files in this process, which keeps them for whoever reads them next."""
    return tags_of_files(os.getcwd(), files)


def look_with(executor: Executor, stop: threading.Event) -> Look:
    """Parse files where the work is done: one that hangs or ends its process harms nobody."""

    def look(files: Sequence[TextFile]) -> Sequence[Looked]:
        work = partial(tags_of_files, os.getcwd())
        looked: dict[int, Looked] = {}
        for (outcome,) in outcomes(executor, work, [[file] for file in files], stop):
            why = f"{outcome.item.path}: {outcome.reason}"
            looked[outcome.place] = why if outcome.result is None else outcome.result
        return [looked.get(place, "it was not looked at") for place in range(len(files))]

    return look


def make_plan(request: Request, look: Look = look_here) -> Plan:
    """The tasks of a request, with the curves from OP to stroke that the plant file gives.

    Raises ``UnreadableSource`` where a source names nothing.
    """
    plan = _plan(request, look)
    valves = {} if request.plant is None else request.plant.valves
    given = {valve.id: valve.given_curve for valve in valves.values()}
    tasks = [replace(task, given_curve=given.get(task.tags.valve)) for task in plan.tasks]
    return replace(plan, tasks=tuple(tasks))


def _plan(request: Request, look: Look) -> Plan:
    if request.plant is not None and not request.sources:
        return _of_plant(request, request.plant, look)
    archives, others = split_archives(request.sources)
    sources = find_sources(others)
    tasks = [task for path in archives for task in _of_archive(request, path)]
    for path in sources.paths:
        tasks += _of_file(request, str(path), look)
    skipped = tuple((str(path), reason) for path, reason in sources.skipped)
    return Plan(tasks=tuple(tasks), not_read=skipped)


def _of_plant(request: Request, plant: Plant, look: Look) -> Plan:
    """Every valve in every file of its source that has its OP tag."""
    wanted = [plant.valves[valve] for valve in request.valves or plant.valves]
    live_window = request.live_window or request.window
    tasks = [live_task(plant, v.id, live_window) for v in wanted if plant.is_live(v.id)]
    archived = [valve for valve in wanted if valve.source in plant.archives]
    tasks += [archive_task(plant, valve.id, request.window) for valve in archived]
    not_read: list[tuple[str, str]] = []
    for source in plant.sources.values():
        valves = [plant.valve_tags(v) for v in wanted if v.source == source.name]
        if source.folder is not None or (request.valves and not valves):
            continue
        files = plant.source_files(source)
        if not files:
            not_read.append((source.name, f"no file matches {source.path} beside {plant.file}"))
        options = ReadOptions(**plant.read_options(source))
        paths = [str(path) for path in files]
        tasks += tasks_of_files(valves, paths, options, request.window, look)
    return Plan(tasks=tuple(tasks), not_read=tuple(not_read))


def live_task(plant: Plant, valve: str, window: Window) -> Task:
    """The task of a valve whose samples are in the plant's store."""
    source = plant.valves[valve].source
    stored = InStore(address=plant.storage, source=source)
    return Task(path=source, tags=plant.valve_tags(valve), stored=stored, window=window)


def archive_task(plant: Plant, valve: str, window: Window) -> Task:
    """The task of a valve that is read from an archive, by whoever does the work."""
    address = plant.archive_of(valve)
    return Task(path=str(address), tags=plant.valve_tags(valve), archive=address, window=window)


def tasks_of_files(
    valves: Sequence[ValveTags],
    files: Sequence[str],
    options: ReadOptions,
    window: Window,
    look: Look = look_here,
) -> list[Task]:
    """One task for each file that holds a valve's OP; a valve that no file holds says so."""
    tasks: list[Task] = []
    seen: set[str] = set()
    broken: list[str] = []
    for path, there in zip(files, _tags_in(valves, files, options, look), strict=True):
        if isinstance(there, str):
            broken.append(there)
            continue
        for valve in valves:
            if valve.tags[Role.OP].tag in there:
                seen.add(valve.valve)
                tasks.append(_task(path, _present(valve, there), options, window))
    for valve in valves:
        if valve.valve not in seen:
            reason = f"the OP tag {valve.tags[Role.OP].tag} is in none of the source's files"
            reason = ". ".join([reason, *broken])
            where = files[0] if len(files) == 1 else ", ".join(files[:3]) or "no file"
            tasks.append(Task(path=where, tags=valve, window=window, reason=reason))
    return tasks


def _tags_in(
    valves: Sequence[ValveTags], files: Sequence[str], options: ReadOptions, look: Look
) -> list[Looked]:
    """The tags in each file: from its header where that tells them, else by parsing it."""
    wanted = {mapping.tag for valve in valves for mapping in valve.tags.values()}
    if not valves:
        return [frozenset() for _ in files]
    tags: dict[str, Looked] = {}
    for path in files:
        if named := header_tags(path, wanted):
            tags[path] = frozenset(named)
    unknown = [path for path in files if path not in tags]
    parsed = look([TextFile(path=path, options=options) for path in unknown])
    tags |= dict(zip(unknown, parsed, strict=True))
    return [tags[path] for path in files]


def _present(valve: ValveTags, there: Set[str]) -> ValveTags:
    """The valve without the optional tags that a file does not have.

    A missing position stays asked for: the reading then says that it is not there, which is worth
    more than a verdict of "no position".
    """
    kept = {
        role: mapping
        for role, mapping in valve.tags.items()
        if role in (Role.OP, Role.MV) or mapping.tag in there
    }
    return replace(valve, tags=kept)


def _of_file(request: Request, path: str, look: Look) -> list[Task]:
    """The tasks of one file: by the plant, by the tags given, or by what the file itself tells."""
    stem = Path(path.removesuffix(".gz")).stem
    options, window = request.read_options, request.window
    if request.plant is not None:
        valves = [request.plant.valve_tags(v) for v in request.plant.valves.values()]
        options = _plant_options(request.plant, path, options)
        tasks = [t for t in tasks_of_files(valves, [path], options, window, look) if not t.reason]
        return tasks or [_hopeless(path, stem, f"{path}: none of the plant's OP tags is in it")]
    if request.tags:
        tags = {role: TagMapping(tag=tag) for role, tag in request.tags.items()}
        return [_task(path, ValveTags(valve=request.valve or stem, tags=tags), options, window)]
    try:
        proposed = propose_valves(open_file(path, options))
    except ConnectorError as error:
        return [_hopeless(path, stem, str(error))]
    if not proposed:
        return [replace(_hopeless(path, stem, NO_VALVE), seen=_columns(path, options))]
    return [_task(path, valve, options, window) for valve in proposed]


def _of_archive(request: Request, path: str) -> list[Task]:
    """The tasks of Parquet files: by the plant, by the tags given, or by what they tell."""
    options = request.read_options
    if request.plant is not None:
        options = _plant_options(request.plant, path, options)
    address = ParquetAddress(path, options)
    try:
        if request.plant is not None:
            there = {info.tag for info in open_archive(address).tags()}
            tagged = [request.plant.valve_tags(valve) for valve in request.plant.valves.values()]
            valves = [valve for valve in tagged if valve.tags[Role.OP].tag in there]
            reason = f"{path}: none of the plant's OP tags is in it"
        elif request.tags:
            tags = {role: TagMapping(tag=tag) for role, tag in request.tags.items()}
            valves = [ValveTags(valve=request.valve or Path(path).stem, tags=tags)]
        else:
            valves, reason = propose_valves(open_archive(address)), NO_VALVE
    except ConnectorError as error:
        return [_hopeless(path, Path(path).stem, str(error))]
    if not valves:
        return [_hopeless(path, Path(path).stem, reason)]
    return [Task(path=path, tags=tags, archive=address, window=request.window) for tags in valves]


def _plant_options(plant: Plant, path: str, given: ReadOptions) -> ReadOptions:
    """How the plant says its exports are written, with what the command line says laid over it.

    The source is the one whose pattern matches the file, or the only one.
    """
    wanted = Path(path).resolve()
    sources = [
        source
        for source in plant.sources.values()
        if len(plant.sources) == 1 or wanted in {f.resolve() for f in plant.source_files(source)}
    ]
    base = (
        ReadOptions(**plant.read_options(sources[0])) if sources else ReadOptions(zone=plant.zone)
    )
    default = ReadOptions()
    said = {
        field.name: getattr(given, field.name)
        for field in fields(given)
        if getattr(given, field.name) != getattr(default, field.name)
    }
    return replace(base, **said)


def _columns(path: str, options: ReadOptions) -> tuple[str, ...]:
    """What a readable file without a recognised valve holds, and why no tag was taken for OP."""
    infos = open_file(path, options).tags()
    names = ", ".join(info.tag for info in infos[:MOST_NAMED])
    more = f" and {len(infos) - MOST_NAMED} more" if len(infos) > MOST_NAMED else ""
    remarks = [f"{info.tag}: {info.remark}" for info in infos[:MOST_NAMED] if info.remark]
    return (f"The file was read; its tags are {names}{more}.", *remarks)


def _task(path: str, tags: ValveTags, options: ReadOptions, window: Window) -> Task:
    return Task(path=path, tags=tags, read_options=options, window=window)


def _hopeless(path: str, valve: str, reason: str) -> Task:
    tags = ValveTags(valve=valve, tags={Role.OP: TagMapping(tag="")})
    return Task(path=path, tags=tags, reason=reason)


def header_tags(path: str, wanted: Set[str]) -> set[str] | None:
    """What the header of the text file ``path`` names, or ``None`` where only reading all of it
    can tell: where none of its first lines names two of the tags that are ``wanted``.

    Names are given as they stand and without a unit in brackets behind them.
    """
    if path.endswith(".gz"):
        return None
    try:
        with Path(path).open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError:
        return None  # reading it will say what is wrong
    for line in head.decode("utf-8-sig", "replace").splitlines()[:LINES]:
        cells = {cell.strip().strip("\"'").strip() for cell in _SEPARATORS.split(line)}
        named = cells | {_UNIT.sub("", cell) for cell in cells}
        if len(named & wanted) >= FEWEST:
            return named
    return None
