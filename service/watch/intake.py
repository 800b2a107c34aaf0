"""``take_in``: store the samples of an export, of the tags that the plant's valves name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stemwatch.connectors.historian import ReadOptions
from stemwatch.models.recording import Role
from stemwatch.service.config import Plant
from stemwatch.service.store.samples.samples import SampleStore
from stemwatch.service.watch.limited_reader import Export, limited_reading

_SHOWN = 8


@dataclass(frozen=True, kw_only=True)
class Taken:
    """The number of stored samples, their tags, and a note on tags that were not in the file."""

    samples: int
    tags: tuple[str, ...]
    note: str


def take_in(
    path: Path, plant: Plant, source: str, samples: SampleStore, memory_bytes: int | None = None
) -> Taken:
    """Store the samples in ``path`` of the tags that valves of ``source`` name.

    Existing samples are not changed, so a file may overlap others and may be read again. A separate
    process reads it with at most ``memory_bytes`` of memory, see ``limited_reading``.
    Raises ``Rejected`` for a file that cannot be read, has none of the tags, or whose times have no
    zone; ``ReaderDied`` where the reading process was killed; ``StoreError``.
    """
    wanted = _wanted(plant, source)
    export = Export(
        path=path,
        options=ReadOptions(**plant.read_options(source)),
        source=source,
        wanted=wanted,
    )
    count = 0
    with limited_reading(export, memory_bytes) as (units, batches):
        samples.describe(source, dict(units))
        for batch in batches:
            samples.write(batch)
            count += len(batch)
    missing = sorted(set(wanted) - set(units))
    note = f"{count} samples of {len(units)} tags"
    if missing:
        more = f" and {len(missing) - _SHOWN} more" if len(missing) > _SHOWN else ""
        note += f"; not in this file: {', '.join(missing[:_SHOWN])}{more}"
    return Taken(samples=count, tags=tuple(units), note=note)


def _wanted(plant: Plant, source: str) -> dict[str, bool]:
    """The tags that valves of the source name, and whether each is a controller's mode."""
    return {
        tag.tag: role is Role.MODE
        for valve in plant.valves.values()
        if valve.source == source
        for role, tag in valve.tags.given().items()
    }
