"""Reading an export in a separate process with limited memory.

A file in a watched folder comes from elsewhere. Unpacking or parsing it may need more memory than
there is; then only the reading process fails, and the service goes on.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from stemwatch.connectors.connector import ConnectorError, UnknownTag
from stemwatch.connectors.historian import ReadOptions
from stemwatch.connectors.historian.columns import Column
from stemwatch.connectors.historian.opened_file import OpenedFile, open_file
from stemwatch.connectors.historian.recordings import find_tag
from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.models.recording import Quality
from stemwatch.models.words import listed
from stemwatch.service.process_lifecycle import begin_child, starting_quietly, worker_context

BATCH = 20_000  # samples in one message, and in one transaction of the store
_SHARE = 0.75  # of the memory that is free now
_LEAST = 256 << 20  # bytes; with less no export can be read
_SHOWN = 8
_MB = 1 << 20


class Rejected(Exception):
    """The file cannot be stored; the text says why and what to do."""


class ReaderDied(Exception):
    """The reading process ended without an answer, killed by the system or a person."""


@dataclass(frozen=True, kw_only=True)
class Export:
    """A file to read, and the wanted tags, with whether each is a controller's mode."""

    path: Path
    options: ReadOptions
    source: str
    wanted: Mapping[str, bool]


@contextmanager
def limited_reading(
    export: Export, memory_bytes: int | None = None
) -> Iterator[tuple[Mapping[str, str], Iterator[SampleBatch]]]:
    """The units of the wanted tags that are in ``export``, and an iterator over their samples.

    ``memory_bytes`` limits the memory of the reading process, by default to three quarters of what
    is free. Raises ``Rejected`` for a file that cannot be read or needs more memory, and
    ``ReaderDied``; the iterator may raise both as well.
    """
    limit = memory_bytes or max(_LEAST, int(_SHARE * free_memory()))
    context = worker_context()
    our_end, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(theirs, export, limit), daemon=True)
    with starting_quietly():
        process.start()
    theirs.close()
    try:
        yield _received(our_end, process), iter(lambda: _received(our_end, process), None)
    finally:
        process.terminate()
        process.join()
        our_end.close()


def _received(our_end: Connection, process: Any) -> Any:
    try:
        message = our_end.recv()
    except EOFError:
        process.join()
        raise ReaderDied(f"the process that read it ended with {process.exitcode}") from None
    if isinstance(message, str):
        raise Rejected(message)
    return message


def _serve(theirs: Connection, export: Export, memory_bytes: int) -> None:
    """The main function of the reading process: sends units, batches of samples, and ``None`` at
    the end; or a sentence that says why the file is rejected."""
    begin_child()
    limit_memory(memory_bytes)
    try:
        for message in _read(export):
            theirs.send(message)
        theirs.send(None)
    except Rejected as error:
        theirs.send(str(error))
    except MemoryError:
        theirs.send(
            f"reading it takes more than the {memory_bytes // _MB} MB of memory that are left for "
            "it; split the export, or give the service more memory"
        )


def _read(export: Export) -> Iterator[Mapping[str, str] | SampleBatch]:
    opened = _opened(export)
    columns = dict(_columns(opened, export.wanted))
    if not columns:
        raise Rejected(_no_tags(opened, export))
    yield {tag: column.unit for tag, column in columns.items()}
    for tag, column in columns.items():
        yield from _batches(export.source, tag, column)


def _opened(export: Export) -> OpenedFile:
    try:
        opened = open_file(export.path, export.options)
    except ConnectorError as error:
        # The connector's sentence without the path: the note lies beside the file.
        raise Rejected(str(error).removeprefix(f"{export.path}: ")) from None
    except (OSError, ValueError) as error:
        raise Rejected(f"{type(error).__name__}: {error}") from None
    if not opened.instants.in_utc:
        raise Rejected(
            f"the times have no zone; give one to the source {export.source!r} in the plant file, "
            'such as zone = "Europe/Berlin"'
        )
    return opened


def _columns(opened: OpenedFile, tags_wanted: Mapping[str, bool]) -> Iterator[tuple[str, Column]]:
    tag_of_column: dict[str, str] = {}
    for tag in tags_wanted:
        with suppress(UnknownTag):
            tag_of_column[tag] = find_tag(opened, tag)
    opened.read_ahead(tag_of_column.values())
    for tag, column in tag_of_column.items():
        yield tag, opened.column(column, as_mode=tags_wanted[tag])


def _batches(source: str, tag: str, column: Column) -> Iterator[SampleBatch]:
    good = column.quality == Quality.GOOD
    for first in range(0, column.ns.size, BATCH):
        part = slice(first, first + BATCH)
        count = column.ns[part].size
        yield SampleBatch(
            source=source,
            tags=(tag,) * count,
            at_us=np.asarray(column.ns[part] // 1000, dtype=np.int64),
            values=column.values[part],
            quality=column.quality[part],
            reasons=tuple("" if ok else "marked so in the export" for ok in good[part]),
        )


def _no_tags(opened: OpenedFile, export: Export) -> str:
    tags = [column.tag for column in opened.table.columns]
    tags_wanted = sorted(export.wanted)
    return (
        f"none of the tags that valves of {export.source!r} name is in it "
        f"({listed(tags_wanted, _SHOWN) or 'no valve has this source'}); its tags are "
        f"{listed(tags, _SHOWN)}"
    )


def limit_memory(more_bytes: int) -> None:
    """Limit this process to ``more_bytes`` beyond its present memory; above there is a
    ``MemoryError``. Only on Linux: Windows has no such limit, and macOS does not enforce it."""
    if sys.platform != "linux":
        return
    import resource

    limit = _in_status("VmData") + more_bytes
    _, hardest = resource.getrlimit(resource.RLIMIT_DATA)
    if hardest != resource.RLIM_INFINITY:
        limit = min(limit, hardest)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hardest))


def free_memory() -> int:
    """Bytes of memory that are free on this machine and in this process's control group."""
    if sys.platform != "linux":
        return 4 << 30  # not used: memory is limited on Linux only
    free = [_in_kilobytes(Path("/proc/meminfo"), "MemAvailable")]
    for group in _control_groups():
        try:
            highest = (group / "memory.max").read_text().strip()
            used = int((group / "memory.current").read_text())
        except (OSError, ValueError):
            continue
        if highest != "max":
            free.append(int(highest) - used)
    return max(0, min(free))


def _control_groups() -> Iterator[Path]:
    """The control group of this process (version 2) and its parents, each of which may have a
    limit."""
    root = Path("/sys/fs/cgroup")
    try:
        lines = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    for line in lines:
        if line.startswith("0::/"):
            own_group = root / line.removeprefix("0::/")
            yield from (
                group for group in (own_group, *own_group.parents) if group.is_relative_to(root)
            )


def _in_status(name: str) -> int:
    return _in_kilobytes(Path("/proc/self/status"), name)


def _in_kilobytes(path: Path, name: str) -> int:
    for line in path.read_text().splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    raise ValueError(f"{path} has no {name}")
