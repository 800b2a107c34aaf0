"""From an export to samples in the store, by the tags that the plant's valves name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stemwatch.connectors.connector import ConnectorError, UnknownTag
from stemwatch.connectors.historian import ReadOptions
from stemwatch.connectors.historian.columns import Column
from stemwatch.connectors.historian.opened_file import OpenedFile, open_file
from stemwatch.connectors.historian.recordings import find_tag
from stemwatch.connectors.modbus.samples import SampleBatch
from stemwatch.models.recording import Quality, Role
from stemwatch.service.config import Plant
from stemwatch.service.store.samples.samples import Samples

BATCH = 20_000  # samples in one transaction
_SHOWN = 8


class Rejected(Exception):
    """The file cannot be taken in; the text says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class Taken:
    """What was taken: how many samples of which tags, and what to know about it."""

    samples: int
    tags: tuple[str, ...]
    note: str


def take_in(path: Path, plant: Plant, source: str, samples: Samples) -> Taken:
    """Store what ``path`` holds of the tags that valves of ``source`` name.

    Samples that are there already stay as they are, so a file may overlap others. Raises
    ``Rejected`` for a file that cannot be read, that has none of the tags, or whose times have no
    zone; ``StoreError`` where the store does not take them.
    """
    try:
        opened = open_file(path, ReadOptions(**plant.read_options(source)))
    except ConnectorError as error:
        raise Rejected(_plain(error, path)) from None
    except (OSError, ValueError, MemoryError) as error:
        raise Rejected(f"{type(error).__name__}: {error}") from None
    if not opened.instants.known:
        raise Rejected(
            f"the times have no zone; give one to the source {source!r} in the plant file, such as "
            'zone = "Europe/Berlin"'
        )
    columns = dict(_columns(opened, plant, source))
    if not columns:
        raise Rejected(_no_tags(opened, plant, source))
    samples.describe(source, {tag: column.unit for tag, column in columns.items()})
    count = 0
    for tag, column in columns.items():
        for batch in _batches(source, tag, column):
            samples.write(batch)
            count += len(batch)
    missing = sorted(set(_wanted(plant, source)) - set(columns))
    note = f"{count} samples of {len(columns)} tags"
    if missing:
        more = f" and {len(missing) - _SHOWN} more" if len(missing) > _SHOWN else ""
        note += f"; not in this file: {', '.join(missing[:_SHOWN])}{more}"
    return Taken(samples=count, tags=tuple(columns), note=note)


def _wanted(plant: Plant, source: str) -> dict[str, Role]:
    """The tags that valves of the source name, with the role of each."""
    return {
        tag.tag: role
        for valve in plant.valves.values()
        if valve.source == source
        for role, tag in valve.tags.given().items()
    }


def _columns(opened: OpenedFile, plant: Plant, source: str) -> Iterator[tuple[str, Column]]:
    for tag, role in _wanted(plant, source).items():
        try:
            there = find_tag(opened, tag)
        except UnknownTag:
            continue
        yield tag, opened.column(there, as_mode=role is Role.MODE)


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


def _no_tags(opened: OpenedFile, plant: Plant, source: str) -> str:
    there = [column.tag for column in opened.table.columns]
    wanted = sorted(_wanted(plant, source))
    return (
        f"none of the {len(wanted)} tags that valves of {source!r} name is in it "
        f"({', '.join(wanted[:_SHOWN]) or 'no valve has this source'}); its tags are "
        f"{', '.join(there[:_SHOWN])}{' ...' if len(there) > _SHOWN else ''}"
    )


def _plain(error: ConnectorError, path: Path) -> str:
    """The connector's sentence without the path: the note lies beside the file."""
    return str(error).removeprefix(f"{path}: ")
