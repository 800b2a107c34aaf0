"""The recordings of files and folders, as callers name them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from stemwatch.connectors.connector import ConnectorError, MappingNeeded
from stemwatch.connectors.settings import nearest
from stemwatch.input_options import InputOptions, name_list, read_options, warned_of_fraction
from stemwatch.models.recording import Recording
from stemwatch.models.screening_result import Screening
from stemwatch.service.run.plan import Request, make_plan
from stemwatch.service.run.task import Task, case_of

if TYPE_CHECKING:
    from stemwatch.models.screening.screen import Case


def all_of_path(path: str, inputs: InputOptions) -> list[Recording | Screening]:
    """Every valve of the files and folders that ``path`` names."""
    recordings: list[Recording | Screening] = []
    for task in _of_valve(path, _tasks(path, inputs), inputs):
        case: Case | Screening = case_of(task)
        recordings.append(
            case if isinstance(case, Screening) else warned_of_fraction(case.recording, inputs)
        )
    return recordings


def one_of_file(path: str, inputs: InputOptions) -> Recording:
    """The one valve of a file that the call means. Raises ``ConnectorError`` where it cannot be
    read, ``MappingNeeded`` where several are meant."""
    tasks = _tasks(path, inputs)
    chosen = _of_valve(path, tasks, inputs)
    if len(chosen) == 1:
        case: Case | Screening = case_of(chosen[0])
        if isinstance(case, Screening):
            raise ConnectorError(" ".join((case.quality.reasons[0], *case.still_seen)))
        return warned_of_fraction(case.recording, inputs)
    names = [task.tags.valve for task in tasks]
    raise MappingNeeded(
        f"{path}: holds {len(names)} valves ({name_list(names)}); say which with "
        f"valve={(names or ['FIC-101'])[0]!r}, or screen them all: stemwatch.screen({path!r})"
    )


def _tasks(path: str, inputs: InputOptions) -> list[Task]:
    """What there is to read in ``path``, with the ranges of the call."""
    if inputs.arrays:
        raise ValueError(
            f"{', '.join(role.value for role in inputs.arrays)}: beside a path expected the name "
            "of a tag; leave the path out to hand over arrays"
        )
    tags = inputs.tags
    request = Request(
        sources=(path,),
        tags=tags,
        valve=inputs.valve if tags else "",
        window=inputs.window,
        read_options=read_options(inputs),
    )
    planned = make_plan(request)
    tasks = []
    for task in planned.tasks:
        mapped = {
            role: inputs.mapping(role, tag.tag, tag.unit) if role.value in inputs.ranges else tag
            for role, tag in task.tags.tags.items()
        }
        tasks.append(replace(task, tags=replace(task.tags, tags=mapped)))
    return tasks


def _of_valve(path: str, tasks: Sequence[Task], inputs: InputOptions) -> Sequence[Task]:
    """The tasks of the valve that the call names; all where it names none, or names the tags, when
    the name is a new one. Raises ``MappingNeeded`` for a valve that is not in ``path``."""
    if not inputs.valve or inputs.tags:
        return tasks
    chosen = [task for task in tasks if task.tags.valve == inputs.valve]
    if not chosen:
        names = [task.tags.valve for task in tasks]
        raise MappingNeeded(
            f"{path}: there is no valve {inputs.valve!r} among {len(names)}"
            f"{nearest(inputs.valve, names)}; expected one of {name_list(names)}"
        )
    return chosen
