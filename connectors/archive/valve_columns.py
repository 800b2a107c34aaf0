"""``ValveColumns``: the tags of one valve as read from an archive, before they share a clock."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from stemwatch.connectors.connector import ConnectorError, ValveTags, Window
from stemwatch.connectors.historian.columns import Column
from stemwatch.connectors.historian.times.epoch import ns_of
from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.models.recording import Bools, Recording, Role

Bounds = tuple[int | None, int | None]
_ALWAYS = (Role.OP, Role.MV)  # always read, and reported where they are missing


@dataclass(frozen=True, kw_only=True)
class ValveColumns:
    """Columns by tag, and whether their dates and zone are known. A ``SampleSource``."""

    source_name: str
    layout: str
    columns: Mapping[str, Column]
    in_utc: bool = True
    zone: str = ""
    decisions: Sequence[str] = ()
    unused_options: Mapping[str, str] = field(default_factory=dict)
    problems: Sequence[str] = ()

    @property
    def names(self) -> Sequence[str]:
        """The tags that were read."""
        return list(self.columns)

    @cached_property
    def digest(self) -> str:
        """sha256 of the samples that were read: an archive as a whole has none."""
        total = hashlib.sha256()
        before = np.zeros(0, dtype=np.int64)
        for tag in sorted(self.columns):
            column = self.columns[tag]
            total.update(tag.encode())
            if not np.array_equal(column.ns, before):  # most tags share one clock
                total.update(np.ascontiguousarray(column.ns).data)
            total.update(np.ascontiguousarray(column.values).data)  # NaN where quality is not good
            before = column.ns
        return total.hexdigest()

    def read_ahead(self, tags: Iterable[str]) -> None:
        """Does nothing: all tags of a valve were read together from the archive."""

    def column(self, tag: str, *, as_mode: bool = False) -> Column:
        """The tag's samples; a mode was read as a mode."""
        return self.columns[tag]


def bounds_of(window: Window, before_s: float = 0.0) -> Bounds:
    """First (inclusive) and last (exclusive) nanosecond to read for a window.

    ``before_s`` seconds more are read before it, so that a tag which is reported when it changes
    has a value to begin with.
    """
    start = ns_of(window.start)
    return None if start is None else start - round(before_s * 1e9), ns_of(window.stop)


def with_existing(
    valve: ValveTags, existing: Callable[[frozenset[str]], Collection[str]]
) -> ValveTags:
    """``valve`` without the optional roles (all but OP and MV) whose tags do not exist.
    ``existing`` is called with the optional tags and returns those that exist; it is not called
    without any."""
    optional = frozenset(m.tag for role, m in valve.tags.items() if role not in _ALWAYS)
    if not optional:
        return valve
    there = existing(optional)
    tags = {role: m for role, m in valve.tags.items() if role in _ALWAYS or m.tag in there}
    return replace(valve, tags=tags)


def need_samples(op: Column, window: Window, source_name: str, contents: Callable[[], str]) -> None:
    """Raise ``ConnectorError`` with the ``contents`` of the source where the controller output has
    no sample in the window."""
    if op.file_ns.size:
        return
    span = (
        "no samples at all"
        if window.start is None and window.stop is None
        else f"no samples between {window.start} and {window.stop}"
    )
    raise ConnectorError(f"{source_name}: {op.tag}: {span}; {contents()}")


def recording_of_columns(
    server: str,
    layout: str,
    zone: str,
    columns: Mapping[str, Column],
    valve: ValveTags,
    window: Window,
    *,
    place: str = "the archive",
) -> Recording:
    """The recording of the ``columns``, by tag, that a ``server`` gave with times in UTC, as the
    sentence ``zone`` says. Raises ``ConnectorError`` where OP has no sample in the window, with
    the words for the ``place`` that holds none."""
    from stemwatch.connectors.historian.recordings import assemble

    nothing_there = f"{place} has nothing there. Ask for another window"
    need_samples(columns[valve.tags[Role.OP].tag], window, server, lambda: nothing_there)
    loaded = ValveColumns(
        source_name=server, layout=layout, columns=columns, zone=zone, decisions=(zone,)
    )
    return assemble(loaded, valve, window)


def empty_column(tag: str) -> Column:
    """A tag without a sample in the window: every instant of it is MISSING."""
    none = np.zeros(0, dtype=np.int64)
    return Column(
        tag=tag,
        unit="",
        description="",
        times=Timeline(none),
        values=np.zeros(0),
        quality=np.zeros(0, dtype=np.uint8),
        file_ns=none,
    )


def within_bounds(column: Column, bounds: Bounds) -> Column:
    """Only the samples between the bounds, since a source may return more than was requested."""
    start, stop = bounds

    def within(ns: Ints) -> Bools:
        keep = np.ones(ns.size, dtype=bool)
        if start is not None:
            keep &= ns >= start
        return keep if stop is None else keep & (ns < stop)

    keep = within(column.ns)
    return replace(
        column,
        times=Timeline(column.ns[keep]),
        values=column.values[keep],
        quality=column.quality[keep],
        file_ns=column.file_ns[within(column.file_ns)],
    )
