"""``Task``: one valve in one source, small enough to send to another process, and its screening."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from stemwatch.connectors.connector import (
    WHOLE,
    ArchiveAddress,
    ArchiveConnector,
    Connector,
    ConnectorError,
    NothingInWindow,
    ValveTags,
    Window,
)
from stemwatch.connectors.historian import HistorianFile, ReadOptions
from stemwatch.models.limits import Limits
from stemwatch.models.recording import Provenance, Recording
from stemwatch.models.screening_result import Screening
from stemwatch.models.stickslip.stroke_curve import KnownCurve
from stemwatch.service.store import DatabaseUrl, StoreError
from stemwatch.service.store.screenings.records import EarlierAnswer, EarlierCurve

if TYPE_CHECKING:  # numba comes with the fits, plots with the report: both are imported late
    from stemwatch.models.screening.screen import Case
    from stemwatch.service.report.charts.valve_plots import ValvePlots
    from stemwatch.service.store.store import Store


@dataclass(frozen=True, kw_only=True)
class StoredBaseline:
    """A valve's baseline network as bytes; ``note`` describes it in a sentence, ``id`` is its
    number in the store. ``worked_at`` is when the valve was worked on since: of what begins after
    that the network says nothing, since a repaired stem moves differently, as it should."""

    network: bytes
    note: str
    window: tuple[datetime | None, datetime | None] = (None, None)
    worked_at: datetime | None = None
    id: int | None = None


@dataclass(frozen=True, kw_only=True)
class InStore:
    """A source whose samples are in the store, with the address at which a worker opens it."""

    address: DatabaseUrl
    source: str


@dataclass(frozen=True, kw_only=True)
class Task:
    """Screen the valve of ``tags``, read from ``path``.

    With ``stored`` or ``archive`` the samples come from there, and ``path`` only names the source.
    ``reason`` is set where it is already known that the valve cannot be screened.
    """

    path: str  # as the user gave it
    tags: ValveTags
    stored: InStore | None = None
    archive: ArchiveAddress | None = None
    read_options: ReadOptions = field(default_factory=ReadOptions)
    window: Window = WHOLE
    baseline: StoredBaseline | None = None
    given_curve: KnownCurve | None = None  # from OP to stroke, as the plant file gives it
    target_band: float | None = None  # of PV about SP, as the plant file gives it
    earlier_curves: tuple[EarlierCurve, ...] = ()  # from OP to stroke, found in earlier windows
    earlier_answers: tuple[EarlierAnswer, ...] = ()  # of OP and PV alone, the last first
    reason: str = ""  # why there is nothing to screen, and what to do about it
    file_remarks: tuple[str, ...] = ()  # why a readable file shows no valve
    position_question: str = ""  # which tag may be the position, where none was taken for it

    @property
    def text_file(self) -> str | None:
        """The text file that has to be parsed for the task, if any."""
        return self.path if self.stored is None and self.archive is None else None


@dataclass(frozen=True, kw_only=True)
class TextFile:
    """A text export whose tags are wanted."""

    path: str
    options: ReadOptions = field(default_factory=ReadOptions)


@lru_cache(maxsize=2)
def _open(path: str, options: ReadOptions, file_state: tuple[int, int]) -> HistorianFile:
    """Cached, so that an export with many valves is parsed once."""
    return HistorianFile(path, options)


def open_file(path: str, options: ReadOptions) -> HistorianFile:
    """The file, parsed at most once while its valves are screened, and again after a change."""
    try:
        state = Path(path).stat()
    except OSError:
        return HistorianFile(path, options)  # reading it reports the error
    return _open(path, options, (state.st_mtime_ns, state.st_size))


@lru_cache(maxsize=2)
def _open_store(address: DatabaseUrl) -> Store:
    """The store, opened once in each process.

    A missing SQLite file is not created: it is on another machine than this worker.
    """
    from stemwatch.service.store.database.engine import existing_engine
    from stemwatch.service.store.store import open_store

    try:
        existing_engine(address).dispose()
    except StoreError as error:
        raise StoreError(
            f"{error} on {platform.node()}, where this work was done. Samples in a SQLite file are "
            "read on their own machine only: keep them in PostgreSQL, or take the executor `local`"
        ) from None
    return open_store(address)


@lru_cache(maxsize=4)
def open_archive(address: ArchiveAddress) -> ArchiveConnector:
    """The archive, opened once in each process, so that its metadata is read once."""
    return address.open()


def recording_of(task: Task) -> Recording:
    """The recording of the task, read from its source in this process."""
    if task.archive is None:
        recording = _connector(task).read(task.tags, task.window)
        provenance = recording.provenance
        provenance = replace(provenance, position_question=task.position_question)
        return replace(recording, provenance=provenance)
    archive = open_archive(task.archive)
    return archive.read(archive.present(task.tags), task.window)


def _connector(task: Task) -> Connector:
    if task.stored is None:
        return open_file(task.path, task.read_options)
    from stemwatch.service.store.samples.connector import StoredSamples

    store = _open_store(task.stored.address)
    return StoredSamples(store.samples, task.stored.source, str(task.stored.address))


def screen_packed(
    limits: Limits, folder: str, tasks: Sequence[Task], *, networks: bool = True
) -> list[tuple[Screening, ValvePlots]]:
    """``screen_tasks`` with plots instead of samples in the results, which makes them small enough
    to send to another process.

    ``folder`` is the working directory of the caller, to which relative paths refer.
    """
    from stemwatch.service.report.charts.valve_plots import plots_instead_of_samples

    _change_to(folder)
    screenings = screen_tasks(tasks, limits, networks=networks)
    screened = []
    while screenings:  # releases the samples of one valve before plotting the next
        screened.append(plots_instead_of_samples(screenings.pop(0)))
    return screened


def tags_of_files(folder: str, files: Sequence[TextFile]) -> list[frozenset[str] | str]:
    """The tags in each file, or the reason why it cannot be read. Done by a worker, since parsing a
    file may take long and may kill the process."""
    _change_to(folder)
    headers: list[frozenset[str] | str] = []
    for file in files:
        try:
            tags = open_file(file.path, file.options).tags()
        except ConnectorError as error:
            headers.append(str(error))
        except (OSError, ValueError, MemoryError) as error:
            headers.append(f"{file.path}: {type(error).__name__}: {error}")
        else:
            headers.append(frozenset(info.tag for info in tags))
    return headers


def _change_to(folder: str) -> None:
    """Change to the caller's working directory, so that relative paths mean the same here: workers
    of a cluster were started elsewhere. A folder that does not exist here is ignored."""
    if os.getcwd() != folder and os.path.isdir(folder):
        os.chdir(folder)


def screen_tasks(
    tasks: Sequence[Task], limits: Limits, *, networks: bool = True
) -> list[Screening]:
    """A screening for each task, in order; for one that cannot be read, with the reason.

    The ``networks`` of these tasks are trained together.
    """
    from stemwatch.models.screening.screen import Options, screen

    results: list[Screening | None] = []
    cases: list[Case] = []
    for task in tasks:
        case = case_of(task)
        results.append(case if isinstance(case, Screening) else None)
        if not isinstance(case, Screening):
            cases.append(case)
    screened = iter(screen(cases, Options(limits=limits, narx=networks)))
    return [
        _with_earlier_answers(next(screened), task) if result is None else result
        for task, result in zip(tasks, results, strict=True)
    ]


def _with_earlier_answers(screening: Screening, task: Task) -> Screening:
    """What OP and PV alone say with the valve's windows before this one counted too; a recording
    without dates has none."""
    from stemwatch.models.without_position.several_recordings import of_loop

    start, newest = screening.window[0], screening.without_position
    if start is None or newest is None:
        return screening
    earlier = [before.answer for before in task.earlier_answers if before.end <= start]
    return replace(screening, without_position=of_loop(newest, earlier))


def given_up(task: Task, reason: str) -> Screening:
    """The screening of a task whose worker hung, died or raised an error."""
    from stemwatch.models.screening.screen import failed

    advice = (
        "Screen this valve alone: a shorter window or a larger valve_timeout_s may do. The other "
        "valves are not affected."
    )
    explanation = f"the work on it was given up: {reason}"
    return failed(task.tags.valve, explanation, advice, Provenance(source=task.path))


def case_of(task: Task) -> Case | Screening:
    """The recording of a task and its valve's baseline as a ``Case``; where the recording cannot be
    read, a ``Screening`` with the reason."""
    from stemwatch.models.screening.screen import Case

    if task.reason:
        return replace(_unread(task, task.reason), still_seen=task.file_remarks)
    try:
        recording = recording_of(task)
    except NothingInWindow as error:
        return replace(_unread(task, str(error)), outside_window=True)
    except (ConnectorError, StoreError) as error:
        return _unread(task, str(error))
    except (OSError, ValueError, MemoryError) as error:
        return _unread(task, f"{task.path}: {type(error).__name__}: {error}")
    case = Case(
        recording=recording,
        known_curve=known_curve(task, recording),
        target_band=task.target_band,
    )
    if task.baseline is None:
        return case
    if recording.start is not None and task.baseline.window == (recording.start, recording.end):
        return replace(case, baseline_note="This window is the baseline.")
    worked_at = task.baseline.worked_at
    if recording.start is not None and worked_at is not None and recording.start >= worked_at:
        note = f"{task.baseline.note} This window begins after that and is not compared with it."
        return replace(case, baseline_note=note)
    from stemwatch.models.narx.network import NarxNetwork

    try:
        network = NarxNetwork.from_bytes(task.baseline.network)
    except ValueError as error:
        note = f"{task.baseline.note} It cannot be read ({error}); set a new one."
        return replace(case, baseline_note=note)
    return replace(case, baseline=network, baseline_note=task.baseline.note)


def known_curve(task: Task, recording: Recording) -> KnownCurve | None:
    """The curve from OP to stroke that the plant file gives, else that of the window before this
    one. A recording without dates has no earlier window."""
    if task.given_curve is not None or recording.start is None or recording.end is None:
        return task.given_curve
    window = (recording.start, recording.end)
    earlier = [
        curve
        for curve in task.earlier_curves
        if curve.end <= recording.end and (curve.start, curve.end) != window
    ]
    last = max(earlier, key=lambda curve: curve.end, default=None)
    return None if last is None else KnownCurve(last.curve)


def _unread(task: Task, reason: str) -> Screening:
    from stemwatch.models.screening.screen import failed

    advice = "Run `stemwatch inspect` on the file: it shows what was understood of it."
    if task.archive is not None:
        advice = "Look at the source in the plant file: whether it has the tags and the window."
    if task.stored is not None:
        advice = "Look at the source's state: whether it is reached, and what it last delivered."
    return failed(task.tags.valve, reason, advice, Provenance(source=task.path))
