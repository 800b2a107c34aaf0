"""What a worker process does with a few valves of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from stemwatch.connectors.connector import ValveTags, Window
from stemwatch.connectors.historian import ReadOptions
from stemwatch.models.limits import Limits
from stemwatch.models.screening_result import Screening
from stemwatch.service.config import Plant
from stemwatch.service.run.plan import archive_task, live_task, tasks_of_files
from stemwatch.service.run.task import Chunk, StoredBaseline, Task, screen_chunk


@dataclass(frozen=True, kw_only=True)
class ValveJob:
    """One valve of a run: where it is read, and what it is compared with.

    ``live`` is its task where its samples are in the store or an archive; else ``files`` are looked
    through.
    """

    valve: str
    tags: ValveTags
    limits: Limits
    live: Task | None = None
    files: tuple[str, ...] = ()
    options: ReadOptions = field(default_factory=ReadOptions)
    window: Window
    baseline: StoredBaseline | None = None


def job_of(plant: Plant, valve: str, window: Window, baseline: StoredBaseline | None) -> ValveJob:
    """The job of one valve of the plant. Raises ``KeyError`` for one that the plant has not."""
    tags = plant.valve_tags(valve)
    job = ValveJob(valve=valve, tags=tags, limits=plant.limits, window=window, baseline=baseline)
    if plant.is_live(valve):
        return replace(job, live=live_task(plant, valve, window))
    if plant.archive_of(valve) is not None:
        return replace(job, live=archive_task(plant, valve, window))
    source = plant.source_of(valve)
    return replace(
        job,
        files=tuple(str(path) for path in plant.source_files(source)),
        options=ReadOptions(**plant.read_options(source)),
    )


def screen_jobs(jobs: Sequence[ValveJob]) -> list[list[Screening]]:
    """The screenings of each job: one for each file that holds the valve, or one with the reason
    why there is none. The valves train together."""
    tasks: list[Task] = []
    lengths: list[int] = []
    for job in jobs:
        found = [job.live] if job.live is not None else _in_files(job)
        tasks += [replace(task, baseline=job.baseline) for task in found]
        lengths.append(len(found))
    if not tasks:
        return [[] for _ in jobs]
    screened = iter(screen_chunk(Chunk(tasks=tuple(tasks), limits=jobs[0].limits)))
    return [[next(screened) for _ in range(length)] for length in lengths]


def _in_files(job: ValveJob) -> list[Task]:
    tasks = tasks_of_files([job.tags], job.files, job.options, job.window)
    return tasks or [Task(path="no file", tags=job.tags, reason="its source has no file")]
