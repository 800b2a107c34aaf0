"""Recordings for the pages: a valve's samples wherever they are."""

from __future__ import annotations

from collections.abc import Callable

from stemwatch.connectors.archive.address import Archive
from stemwatch.connectors.connector import ConnectorError, ValveTags, Window
from stemwatch.connectors.historian import ReadOptions
from stemwatch.models.recording import Recording
from stemwatch.service.config import Plant
from stemwatch.service.run.task import open_archive, open_file
from stemwatch.service.store.samples.connector import StoredSamples
from stemwatch.service.store.store import Store


def reader(plant: Plant, store: Store) -> Callable[[str, Window], Recording | None]:
    """A function that gives the recording of a valve in a window, or ``None`` where there is
    none. It raises ``ConnectorError`` for a valve that the plant file does not describe."""

    def read(valve: str, window: Window) -> Recording | None:
        if valve not in plant.valves:
            raise ConnectorError(f"the plant file does not describe the valve {valve!r}")
        if plant.is_live(valve):
            source = StoredSamples(store.samples, plant.valves[valve].source)
            try:
                return source.read(plant.valve_tags(valve), window)
            except ConnectorError:
                return None  # nothing was collected in this window
        address = plant.archive_of(valve)
        return (
            _in_files(plant, valve, window)
            if address is None
            else _archived(open_archive(address), plant.valve_tags(valve), window)
        )

    return read


def _archived(archive: Archive, tags: ValveTags, window: Window) -> Recording | None:
    try:
        return archive.read(archive.present(tags), window)
    except ConnectorError:
        return None  # the archive has nothing in this window


def _in_files(plant: Plant, valve: str, window: Window) -> Recording | None:
    """From the newest of the source's files that has samples in the window."""
    source = plant.source_of(valve)
    options = ReadOptions(**plant.read_options(source))
    for path in reversed(plant.source_files(source)):
        try:
            return open_file(str(path), options).read(plant.valve_tags(valve), window)
        except ConnectorError:
            continue
    return None
