"""``StoredSamples``: the connector to samples in the store."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from stemwatch.connectors.archive.valve_columns import ValveColumns
from stemwatch.connectors.connector import (
    WHOLE,
    ConnectorError,
    TagInfo,
    UnknownTag,
    ValveTags,
    Window,
    nearest_names,
)
from stemwatch.connectors.historian.columns import Column
from stemwatch.connectors.historian.recordings import assemble, need_op
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.models.recording import Recording, Role
from stemwatch.models.words import times
from stemwatch.service.store.samples.samples import SampleStore, StoredTag

LAYOUT = "samples in the store"


class StoredSamples:
    """The samples of one source in the store; implements ``Connector``.

    A recording is made of them by the rules of exports and archives: one even clock, percent,
    doubts as sentences. ``describe`` names the store in messages.
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
        need_op(self._where, valve)
        stored_tags = {tag.name: tag for tag in self._samples.tags(self.source)}
        columns = {
            mapping.tag: self._column(mapping.tag, stored_tags, window)
            for mapping in valve.tags.values()
        }
        op = columns[valve.tags[Role.OP].tag]
        if not np.isfinite(op.values).any():
            raise ConnectorError(self._why_no_samples(op, window))
        collected = ValveColumns(
            source_name=self._where,
            layout=LAYOUT,
            columns=columns,
            zone="stored in UTC",
            decisions=(f"The samples come from the store, where {self.source} was collected.",),
        )
        return assemble(collected, valve, window)

    def _column(self, tag: str, tags_by_name: dict[str, StoredTag], window: Window) -> Column:
        if tag not in tags_by_name:
            close_names = nearest_names(tag, sorted(tags_by_name))
            raise UnknownTag(
                f"source {self.source}: there is no sample of {tag!r} among {len(tags_by_name)} "
                "tags; the nearest are "
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

    def _why_no_samples(self, op: Column, window: Window) -> str:
        bounds = self._samples.bounds(self.source, op.tag)
        stored_span = "there is none" if bounds is None else f"the store has {_span(*bounds)}"
        reason_counts = self._samples.reasons(self.source, op.tag, window.start, window.stop)
        bad = "; ".join(
            f"{words} ({times(count)})" for words, count in list(reason_counts.items())[:3]
        )
        return (  # without the database's address: pages show this to everybody
            f"source {self.source}: {op.tag}: no good sample of the controller output in "
            f"{_span(window.start, window.stop)}; {stored_span}{f'. Bad: {bad}' if bad else ''}"
        )


def _span(start: datetime | None, stop: datetime | None) -> str:
    """A window to the second, in UTC, and said to be."""
    first, last = (
        "…" if end is None else f"{end.astimezone(UTC):%Y-%m-%d %H:%M:%S}" for end in (start, stop)
    )
    return f"{first} to {last} UTC"
