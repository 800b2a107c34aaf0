"""``StoredSamples``: the connector to samples in the store."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta

import numpy as np

from stemwatch.connectors.archive.valve_columns import bounds_of
from stemwatch.connectors.connector import (
    WHOLE,
    ConnectorError,
    MappingNeeded,
    TagInfo,
    TagMapping,
    UnknownTag,
    ValveTags,
    Window,
    nearest_names,
)
from stemwatch.connectors.historian.times.source_clock import (
    Grid,
    clock_facts,
    lay_column,
    make_grid,
    times_stored,
)
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.connectors.historian.values.columns import Column, sharing_times
from stemwatch.models.recording import PERCENT, Provenance, Recording, Role, Signal
from stemwatch.service.store.samples.samples import SampleStore, StoredTag
from stemwatch.service.store.samples.tables import EPOCH

LAYOUT = "samples in the store"


class StoredSamples:
    """The samples of one source in the store; implements ``Connector``.

    Samples are laid on the even clock of OP, each at the nearest instant; values reported only on
    change are held until the next one, as in exports. ``describe`` names the store in messages.
    """

    def __init__(self, samples: SampleStore, source: str, describe: str = "the store") -> None:
        self._samples = samples
        self.source = source
        self._where = f"{describe}, source {source}"

    def tags(self) -> Sequence[TagInfo]:
        """Every tag of the source that ever had a sample; roles are not guessed."""
        return [TagInfo(tag=tag.name, unit=tag.unit) for tag in self._samples.tags(self.source)]

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording:
        """The recording of ``valve`` in ``window``.

        Raises ``MappingNeeded`` without a tag for OP, ``UnknownTag`` for a tag that never had a
        sample and ``ConnectorError`` where the window holds too few.
        """
        if Role.OP not in valve.tags:
            raise MappingNeeded(f"{self._where}: {valve.valve}: no tag is given for OP")
        stored_tags = {tag.name: tag for tag in self._samples.tags(self.source)}
        columns = sharing_times(
            {role: self._column(tag.tag, stored_tags, window) for role, tag in valve.tags.items()}
        )
        grid = self._grid(columns[Role.OP], window)
        notes = [f"The samples come from the store, where {self.source} was collected."]
        stored = times_stored(columns.values())
        signals = {
            role: _signal(column, valve.tags[role], grid, role, stored, notes)
            for role, column in columns.items()
        }
        return Recording(
            valve=valve.valve,
            signals=signals,
            interval_s=grid.interval_s,
            start=EPOCH + timedelta(microseconds=round(grid.start_ns / 1000)),
            clock=clock_facts(columns[Role.OP].file_ns, "stored in UTC"),
            provenance=Provenance(source=self._where, layout=LAYOUT, decisions=tuple(notes)),
        )

    def _column(self, tag: str, tags_by_name: dict[str, StoredTag], window: Window) -> Column:
        if tag not in tags_by_name:
            close_names = nearest_names(tag, sorted(tags_by_name))
            raise UnknownTag(
                f"{self._where}: there is no sample of {tag!r} among {len(tags_by_name)} tags; the "
                "nearest are "
                f"{close_names or 'none: nothing was collected yet'}"
            )
        samples = self._samples.read(self.source, tag, window.start, window.stop)
        ns = samples.at_us * 1000
        return Column(
            tag=tag,
            unit=tags_by_name[tag].unit,
            description="",
            times=Timeline(ns),
            values=samples.values,
            quality=samples.quality,
            file_ns=ns,
        )

    def _grid(self, op: Column, window: Window) -> Grid:
        if not np.isfinite(op.values).any():
            raise ConnectorError(self._why_no_samples(op, window))
        return make_grid(op.times, op.tag, self._where, bounds_of(window))

    def _why_no_samples(self, op: Column, window: Window) -> str:
        bounds = self._samples.bounds(self.source, op.tag)
        stored_span = (
            "there is none" if bounds is None else f"the store has {bounds[0]} to {bounds[1]}"
        )
        reason_counts = self._samples.reasons(self.source, op.tag, window.start, window.stop)
        bad = "; ".join(
            f"{words} ({count} times)" for words, count in list(reason_counts.items())[:3]
        )
        return (
            f"{self._where}: {op.tag}: no good sample of the controller output from "
            f"{window.start} to {window.stop}; {stored_span}{f'. Bad: {bad}' if bad else ''}"
        )


def _signal(
    column: Column, mapping: TagMapping, grid: Grid, role: Role, stored: Ints, notes: list[str]
) -> Signal:
    on_grid = lay_column(column, grid, is_clock=role is Role.OP, stored=stored)
    if on_grid.decision:
        notes.append(on_grid.decision)
    values, unit = on_grid.values, mapping.unit or column.unit
    if role is not Role.MODE and mapping.low is not None and mapping.high is not None:
        values = 100.0 * (values - mapping.low) / (mapping.high - mapping.low)
        unit = PERCENT
    elif not unit and role in (Role.OP, Role.MV):
        notes.append(f"{column.tag}: no unit is known; the values were taken as percent.")
        unit = PERCENT
    return Signal(
        values=values,
        quality=on_grid.quality,
        tag=column.tag,
        unit=unit,
        range=mapping.process_range(column.unit),
        scaled=mapping.scales,
    )
