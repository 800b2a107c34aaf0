"""``Inspection``: what the reader understood of a file and how good its data is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from stemwatch.connectors.historian.columns import Column
from stemwatch.connectors.historian.source_clock import clock_facts, interval_ns
from stemwatch.connectors.historian.times.epoch import instant_of
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.models.recording import ClockFacts, Quality
from stemwatch.models.signals import forensics

if TYPE_CHECKING:
    from stemwatch.connectors.historian.opened_file import OpenedFile
    from stemwatch.connectors.historian.tags.roles import Candidate

_LINES_SHARE = 0.2  # more interior points on straight lines than this: a compressed archive


@dataclass(frozen=True, kw_only=True)
class TagInspection:
    """One tag: what it seems to be, and the evidence of what recorder and archive did to it."""

    tag: str
    unit: str
    description: str
    role: str  # op, mv, pv, sp, mode, or empty where nothing is proposed
    valve: str
    remark: str
    samples: int  # with a value that can be used
    bad_share: float  # of the tag's rows, 0 to 1
    interval_s: float | None  # between its samples
    own_interval_s: float | None  # between new values, where slower
    low: float | None
    high: float | None
    noise_sigma: float  # unit of the tag
    quantum: float  # unit of the tag; 0: none seen
    repeat_share: float  # neighbouring samples that are exactly equal, 0 to 1
    longest_repeat_s: float
    line_share: float  # samples on a straight line between their neighbours, 0 to 1
    compressed: bool  # lines instead of samples, or reported by exception
    frozen: bool  # one value for a quarter of the record or more
    reasons: Mapping[str, int] = field(default_factory=dict)  # what stood where no value is


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """One file. ``start`` and ``end`` are UTC, ``None`` where the zone is not known."""

    source: str
    digest: str
    layout: str
    encoding: str
    separator: str
    decimal: str
    zone: str  # how times became UTC, in one sentence
    zone_name: str  # the zone that was given, IANA; empty where none was
    rows: int
    interval_s: float | None
    start: datetime | None
    end: datetime | None
    clock: ClockFacts
    tags: tuple[TagInspection, ...]
    decisions: tuple[str, ...]
    problems: tuple[str, ...]
    unused_options: frozenset[str]  # names of those that were given and made no difference

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; times in ISO form. The decisions have the unused options."""
        out = asdict(self)
        del out["unused_options"]
        for name in ("start", "end"):
            instant = getattr(self, name)
            out[name] = None if instant is None else instant.isoformat()
        return out


def inspect_file(opened: OpenedFile) -> Inspection:
    """Look at every tag of an opened file."""
    instants, table = opened.instants, opened.table
    ns = np.unique(instants.ns[instants.ok])
    tags = tuple(_inspect(opened.column(role.tag), role) for role in opened.roles())
    decisions = list(opened.notes.decisions)
    for column in table.columns:
        decisions += opened.column(column.tag).decisions
    busiest = max((opened.column(c.tag) for c in table.columns), key=lambda c: c.file_ns.size)
    return Inspection(
        source=str(opened.path),
        digest=opened.digest,
        layout=table.layout,
        encoding=opened.encoding,
        separator=table.separator,
        decimal=opened.decimal,
        zone=instants.zone,
        zone_name=opened.options.zone or "",
        rows=len(table.numbers),
        interval_s=_interval_s(busiest),
        start=instant_of(int(ns[0])) if instants.in_utc else None,
        end=instant_of(int(ns[-1])) if instants.in_utc else None,
        clock=clock_facts(busiest.file_ns, instants.zone),
        tags=tags,
        decisions=tuple(dict.fromkeys(decisions)),
        problems=tuple(opened.notes.problems),
        unused_options=frozenset(opened.unused_options),
    )


def _interval_s(column: Column) -> float | None:
    """The interval of the grid that a recording on this tag's rows would have."""
    times = Timeline(column.file_ns)
    return interval_ns(times) / 1e9 if times.steps.size else None


def _own_step_s(column: Column) -> float | None:
    """Seconds between the tag's samples: by the clock where they come evenly, else the median."""
    times = column.times
    if times.usual_step is None:
        return None
    return (times.usual_step if times.by_exception else interval_ns(times)) / 1e9


def _inspect(column: Column, candidate: Candidate) -> TagInspection:
    from stemwatch.models.record_checks.frozen import (
        mostly_one_value,  # loads numba; --help does not need it
    )

    values = column.values
    finite = values[np.isfinite(values)]
    interval_s = _own_step_s(column)
    lines = float(np.mean(forensics.interpolated(values))) if values.size > 2 else 0.0
    longest = forensics.longest_repeat(values) if values.size > 1 else 1
    return TagInspection(
        tag=candidate.tag,
        unit=candidate.unit,
        description=candidate.description,
        role="" if candidate.role is None else candidate.role.value,
        valve=candidate.valve,
        remark=candidate.remark,
        samples=int(finite.size),
        bad_share=_bad_share(column),
        interval_s=interval_s,
        own_interval_s=candidate.own_interval_s,
        low=float(finite.min()) if finite.size else None,
        high=float(finite.max()) if finite.size else None,
        noise_sigma=forensics.noise_sigma(values),
        quantum=forensics.quantum(values),
        repeat_share=forensics.repeat_share(values),
        longest_repeat_s=longest * (interval_s or 0.0) if longest > 1 else 0.0,
        line_share=lines,
        compressed=lines > _LINES_SHARE or column.times.by_exception,
        frozen=mostly_one_value(longest, finite.size),
        reasons=dict(column.reasons),
    )


def _bad_share(column: Column) -> float:
    rows = column.file_ns.size
    usable = int((column.quality == Quality.GOOD).sum())
    return 1.0 - usable / rows if rows else 1.0
