"""From sources on the command line to tasks; a source that names nothing does not stop the
others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from stemwatch.connectors.connector import ConnectorError
from stemwatch.models.recording import Role
from stemwatch.service.run.plan import Plan, Request, make_plan
from stemwatch.service.run.task import Task


@dataclass(frozen=True, kw_only=True)
class RecordingToExplain:
    """One valve to explain, or a source without one. ``source`` is the path as the user gave it."""

    source: str
    valve: str
    task: Task | None = None
    reason: str = ""  # why there is nothing to explain


@dataclass(frozen=True, kw_only=True)
class RecordingsToExplain:
    """The requested recordings in order, and for other files of a folder why they are no
    recordings."""

    valves: tuple[RecordingToExplain, ...]
    left_out: tuple[tuple[str, str], ...] = ()


def recordings_to_explain(request: Request) -> RecordingsToExplain:
    """Everything that ``request`` names; a file that is named twice is listed once."""
    todo: dict[tuple[Path, str, str], RecordingToExplain] = {}
    left_out: dict[str, str] = {}
    for source, planned in _planned(request):
        if isinstance(planned, str):
            named = [RecordingToExplain(source=source, valve=Path(source).stem, reason=planned)]
        else:
            named = [_named(task, source) for task in planned.tasks]
            left_out.update(planned.not_read)
        for entry in named:
            op = entry.task.tags.tags[Role.OP].tag if entry.task is not None else ""
            todo.setdefault((Path(entry.source), entry.valve, op), entry)
    return RecordingsToExplain(valves=tuple(todo.values()), left_out=tuple(left_out.items()))


def _planned(request: Request) -> Iterator[tuple[str, Plan | str]]:
    """Each source with its tasks, or with the reason why it gives none."""
    if not request.sources:
        yield "", make_plan(request)
        return
    for source in request.sources:
        try:
            yield source, make_plan(replace(request, sources=(source,)))
        except (ConnectorError, OSError, ValueError) as error:
            yield source, str(error)


def _named(task: Task, source: str) -> RecordingToExplain:
    """The task under the path as it was typed: ``./a.csv`` stays ``./a.csv``."""
    path = source if source and Path(source) == Path(task.path) else task.path
    return RecordingToExplain(source=path, valve=task.tags.valve, task=task, reason=task.reason)
