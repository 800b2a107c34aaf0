"""From a request to tasks: which files, which valves in each, which tags."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from stemwatch.connectors.connector import (
    WHOLE,
    ConnectorError,
    TagInfo,
    TagMapping,
    ValveTags,
    Window,
)
from stemwatch.connectors.historian import (
    ReadOptions,
    find_sources,
    position_question,
    propose_valves,
    valves_among,
)
from stemwatch.connectors.historian.header_names import header_names
from stemwatch.connectors.historian.options import given_options
from stemwatch.connectors.parquet import ParquetAddress, split_archives
from stemwatch.models.recording import Role
from stemwatch.models.words import listed
from stemwatch.service.config import Plant
from stemwatch.service.config.schema import Valve
from stemwatch.service.executors import Executor, outcomes
from stemwatch.service.run.task import (
    InStore,
    Task,
    TextFile,
    open_archive,
    open_file,
    tags_of_files,
)

MOST_NAMED = 12  # tags of a file that a message lists
NO_VALVE = (
    "no controller output was recognised in this file; say which tags are meant with --op and "
    "--mv, or in a plant.toml (`stemwatch inspect` shows the tags)."
)
ONE_TAG = (
    "this file holds one tag only, and OP, PV and position of a valve must stand in one file. "
    "Export the tags of the loop together, or put the files below each other with a column for the "
    "tag: time, tag, value."
)

TagsOrReason = frozenset[str] | str  # the tags in a file, or why it cannot be read
ReadTags = Callable[[Sequence[TextFile]], Sequence[TagsOrReason]]


@dataclass(frozen=True, kw_only=True)
class Request:
    """What to screen: sources, with a plant, with tags, or with neither (then valves are proposed).

    ``valves`` are those of the plant that are screened, or all of them. ``live_window`` applies to
    valves whose samples are in the store; by default ``window`` applies to them too.
    """

    sources: Sequence[str] = ()
    plant: Plant | None = None
    tags: dict[Role, str] = field(default_factory=dict)
    valve: str = ""
    valves: tuple[str, ...] = ()
    window: Window = WHOLE
    live_window: Window | None = None
    read_options: ReadOptions = field(default_factory=ReadOptions)

    @property
    def zone(self) -> str:
        """The time zone in which the run speaks of times."""
        return (self.plant.zone if self.plant else None) or self.read_options.zone or "UTC"

    def chosen(self, plant: Plant) -> list[Valve]:
        """The valves of ``plant`` to screen, in the order in which they are asked for."""
        return [plant.valves[valve] for valve in self.valves or plant.valves]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Tasks in order, and (source, reason) for sources that are not recordings."""

    tasks: tuple[Task, ...]
    not_read: tuple[tuple[str, str], ...] = ()


def read_tags_here(files: Sequence[TextFile]) -> Sequence[TagsOrReason]:
    """Parse the files in this process, which caches them for reading the recordings."""
    return tags_of_files(os.getcwd(), files)


def read_tags_with(executor: Executor, stop: threading.Event) -> ReadTags:
    """Parse files in the executor's workers, so that a file that hangs or kills its process does
    not affect this one."""

    def read_tags(files: Sequence[TextFile]) -> Sequence[TagsOrReason]:
        work = partial(tags_of_files, os.getcwd())
        answers: dict[int, TagsOrReason] = {}
        for (outcome,) in outcomes(executor, work, [[file] for file in files], stop):
            reason = f"{outcome.item.path}: {outcome.reason}"
            answers[outcome.index] = reason if outcome.result is None else outcome.result
        return [answers.get(index, "it was not looked at") for index in range(len(files))]

    return read_tags


def make_plan(request: Request, read_tags: ReadTags = read_tags_here) -> Plan:
    """The tasks of a request, with what the plant file gives of each valve beside its tags.

    Raises ``UnreadableSource`` where a source matches nothing.
    """
    plan = _plan(request, read_tags)
    if request.plant is None:
        return plan
    valves = request.plant.valves
    return replace(plan, tasks=tuple(_with_settings(task, valves) for task in plan.tasks))


def _with_settings(task: Task, valves: Mapping[str, Valve]) -> Task:
    """``task`` with the curve and the target band that the plant file gives of its valve."""
    valve = valves.get(task.tags.valve)
    if valve is None:
        return task
    return replace(task, given_curve=valve.given_curve, target_band=valve.target_band)


def _plan(request: Request, read_tags: ReadTags) -> Plan:
    """The tasks of the plant's own sources, or of the files and archives that a request names."""
    if request.plant is not None and not request.sources:
        return _of_plant(request, request.plant, read_tags)
    archives, others = split_archives(request.sources)
    sources = find_sources(others)
    tasks = [task for path in archives for task in _of_archive(request, path)]
    for path in sources.paths:
        tasks += _of_file(request, str(path), read_tags)
    skipped = tuple((str(path), reason) for path, reason in sources.skipped)
    return Plan(tasks=tuple(tasks), not_read=skipped)


def _of_plant(request: Request, plant: Plant, read_tags: ReadTags) -> Plan:
    """Every valve in every file of its source that has its OP tag."""
    chosen = request.chosen(plant)
    live_window = request.live_window or request.window
    live = [valve for valve in chosen if plant.is_live(valve.id)]
    tasks = [live_task(plant, valve.id, live_window) for valve in live]
    archived = [valve for valve in chosen if valve.source in plant.archives]
    tasks += [archive_task(plant, valve.id, request.window) for valve in archived]
    not_read: list[tuple[str, str]] = []
    for source in plant.sources.values():
        valves = [plant.valve_tags(valve) for valve in chosen if valve.source == source.name]
        if source.folder is not None or (request.valves and not valves):
            continue
        files = plant.source_files(source)
        if not files:
            not_read.append((source.name, f"no file matches {source.path} beside {plant.file}"))
        options = ReadOptions(**plant.read_options(source))
        paths = [str(path) for path in files]
        of_files, unread = tasks_of_files(valves, paths, options, request.window, read_tags)
        tasks += of_files
        if not any(task.reason for task in of_files):  # else the reason has them
            not_read += unread
    return Plan(tasks=tuple(tasks), not_read=tuple(not_read))


def live_task(plant: Plant, valve: str, window: Window) -> Task:
    """The task of a valve whose samples are in the plant's store."""
    source = plant.valves[valve].source
    stored = InStore(address=plant.storage, source=source)
    return Task(path=source, tags=plant.valve_tags(valve), stored=stored, window=window)


def archive_task(plant: Plant, valve: str, window: Window) -> Task:
    """The task of a valve that the worker reads from an archive."""
    address = plant.archive_of(valve)
    return Task(path=str(address), tags=plant.valve_tags(valve), archive=address, window=window)


def tasks_of_files(
    valves: Sequence[ValveTags],
    files: Sequence[str],
    options: ReadOptions,
    window: Window,
    read_tags: ReadTags = read_tags_here,
) -> tuple[list[Task], list[tuple[str, str]]]:
    """One task for each file that holds a valve's OP; a valve that no file holds gets a task with
    the reason. And the files that could not be read, each with its reason: last night's export may
    be among them."""
    tasks: list[Task] = []
    in_a_file: set[str] = set()
    unreadable: dict[str, str] = {}
    for path, tags in zip(files, _tags_in(valves, files, options, read_tags), strict=True):
        if isinstance(tags, str):
            unreadable[path] = tags
            continue
        for valve in valves:
            if valve.tags[Role.OP].tag in tags:
                in_a_file.add(valve.valve)
                tasks.append(_task(path, _present(valve, tags), options, window))
    for valve in valves:
        if valve.valve in in_a_file:
            continue
        reason = f"the OP tag {valve.tags[Role.OP].tag} is in none of the source's files"
        reason = ". ".join([reason, *unreadable.values()])
        file_names = files[0] if len(files) == 1 else ", ".join(files[:3]) or "no file"
        tasks.append(Task(path=file_names, tags=valve, window=window, reason=reason))
    return tasks, [(path, reason.removeprefix(f"{path}: ")) for path, reason in unreadable.items()]


def _tags_in(
    valves: Sequence[ValveTags], files: Sequence[str], options: ReadOptions, read_tags: ReadTags
) -> list[TagsOrReason]:
    """The tags in each file: from its header where that names them, else by parsing the file."""
    tags_wanted = {mapping.tag for valve in valves for mapping in valve.tags.values()}
    if not valves:
        return [frozenset() for _ in files]
    tags: dict[str, TagsOrReason] = {}
    for path in files:
        if names := header_names(path, tags_wanted):
            tags[path] = frozenset(names)
    unknown = [path for path in files if path not in tags]
    parsed = read_tags([TextFile(path=path, options=options) for path in unknown])
    tags |= dict(zip(unknown, parsed, strict=True))
    return [tags[path] for path in files]


def _present(valve: ValveTags, tags_in_file: Set[str]) -> ValveTags:
    """The valve without the optional tags that a file does not have.

    A missing MV tag is kept: reading then reports it as missing, which tells more than the verdict
    "no position".
    """
    present = {
        role: mapping
        for role, mapping in valve.tags.items()
        if role in (Role.OP, Role.MV) or mapping.tag in tags_in_file
    }
    return replace(valve, tags=present)


def _of_file(request: Request, path: str, read_tags: ReadTags) -> list[Task]:
    """The tasks of one file: by the plant, by given tags, or by the roles of its own tags."""
    stem = Path(path.removesuffix(".gz")).stem
    options, window = request.read_options, request.window
    if request.plant is not None:
        valves = [request.plant.valve_tags(valve) for valve in request.chosen(request.plant)]
        options = _plant_options(request.plant, path, options)
        tasks, unread = tasks_of_files(valves, [path], options, window, read_tags)
        readable = [task for task in tasks if not task.reason]
        why = unread[0][1] if unread else "none of the plant's OP tags is in it"
        reason = f"{path}: {why}"
        return readable or [_not_readable(path, stem, reason)]
    if request.tags:
        tags = {role: TagMapping(tag=tag) for role, tag in request.tags.items()}
        return [_task(path, ValveTags(valve=request.valve or stem, tags=tags), options, window)]
    try:
        infos = open_file(path, options).tags()
    except ConnectorError as error:
        return [_not_readable(path, stem, str(error))]
    proposed = valves_among(infos)
    if not proposed:
        reason = ONE_TAG if len(infos) == 1 else NO_VALVE
        return [replace(_not_readable(path, stem, reason), file_remarks=_columns(infos))]
    return [
        replace(
            _task(path, valve, options, window),
            position_question=position_question(valve.valve, infos),
        )
        for valve in proposed
    ]


def _of_archive(request: Request, path: str) -> list[Task]:
    """The tasks of Parquet files: by the plant, given tags, or the roles of their own tags."""
    options = request.read_options
    if request.plant is not None:
        options = _plant_options(request.plant, path, options)
    address = ParquetAddress(path, options)
    no_valve = NO_VALVE
    try:
        if request.plant is not None:
            in_archive = {info.tag for info in open_archive(address).tags()}
            tagged = [request.plant.valve_tags(valve) for valve in request.chosen(request.plant)]
            valves = [valve for valve in tagged if valve.tags[Role.OP].tag in in_archive]
            no_valve = f"{path}: none of the plant's OP tags is in it"
        elif request.tags:
            tags = {role: TagMapping(tag=tag) for role, tag in request.tags.items()}
            valves = [ValveTags(valve=request.valve or Path(path).stem, tags=tags)]
        else:
            valves = propose_valves(open_archive(address))
    except ConnectorError as error:
        return [_not_readable(path, Path(path).stem, str(error))]
    if not valves:
        return [_not_readable(path, Path(path).stem, no_valve)]
    return [Task(path=path, tags=tags, archive=address, window=request.window) for tags in valves]


def _plant_options(plant: Plant, path: str, options: ReadOptions) -> ReadOptions:
    """The reading options of the plant's source, overridden by those of the command line.

    The source is the one whose pattern matches the file, or the plant's only one.
    """
    resolved = Path(path).resolve()
    sources = [
        source
        for source in plant.sources.values()
        if len(plant.sources) == 1 or resolved in {f.resolve() for f in plant.source_files(source)}
    ]
    base = (
        ReadOptions(**plant.read_options(sources[0])) if sources else ReadOptions(zone=plant.zone)
    )
    return replace(base, **given_options(options))


def _columns(infos: Sequence[TagInfo]) -> tuple[str, ...]:
    """The tags of a readable file without a recognised valve, and why none was taken for OP."""
    names = listed([info.tag for info in infos], MOST_NAMED)
    tag_remarks = [f"{info.tag}: {info.remark}" for info in infos[:MOST_NAMED] if info.remark]
    return (f"The file was read; its tags are {names}.", *tag_remarks)


def _task(path: str, tags: ValveTags, options: ReadOptions, window: Window) -> Task:
    return Task(path=path, tags=tags, read_options=options, window=window)


def _not_readable(path: str, valve: str, reason: str) -> Task:
    """A task whose result is the reason why no valve of ``path`` can be screened."""
    tags = ValveTags(valve=valve, tags={Role.OP: TagMapping(tag="")})
    return Task(path=path, tags=tags, reason=reason)
