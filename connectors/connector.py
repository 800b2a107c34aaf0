"""``Connector``, the protocol of every source of data, with its arguments and its errors."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Protocol, runtime_checkable

from stemwatch.models.recording import PERCENT, ProcessRange, Recording, Role


class ConnectorError(Exception):
    """A source could not be read. The text names the source, what was found, what was expected,
    and what to do about it."""


class UnreadableSource(ConnectorError):
    """The source as a whole cannot be read: missing, not text, no time column, no numbers."""


class NothingInWindow(ConnectorError):
    """The source is readable, but holds no sample in the window that was asked for."""


class MappingNeeded(ConnectorError):
    """The source is readable, but a person must say which tag is OP or MV."""


class UnknownTag(ConnectorError):
    """A tag was asked for that the source does not have; the text lists the nearest ones."""


def nearest_names(tag: str, names: Collection[str]) -> str:
    """Up to three quoted ``names`` like ``tag``, else the first five; "" where there are none."""
    nearest = difflib.get_close_matches(tag, names, n=3, cutoff=0.4) or list(names)[:5]
    return ", ".join(map(repr, nearest))


@dataclass(frozen=True, kw_only=True)
class TagMapping:
    """One tag of a valve: where the signal is, and what turns it into percent.

    ``low`` and ``high`` are the engineering values at 0 % and 100 %; without them the values are
    taken as they are, as percent where ``unit`` is ``%`` or empty. ``deviation`` is that of the
    archive's compression (swinging door), in the tag's unit, where the plant states it.
    """

    tag: str
    unit: str = ""
    low: float | None = None
    high: float | None = None
    deviation: float | None = None

    @property
    def scales(self) -> bool:
        """Whether the values at 0 % and at 100 % are stated."""
        return self.low is not None and self.high is not None

    def process_range(self, unit: str = "") -> ProcessRange | None:
        """The range in the tag's own unit, else in ``unit``, which the source names; ``None`` where
        range or unit is not known, or is percent already.
        """
        own_unit = self.unit or unit
        if self.low is None or self.high is None or own_unit in ("", PERCENT):
            return None
        return ProcessRange(low=self.low, high=self.high, unit=own_unit)


@dataclass(frozen=True, kw_only=True)
class ValveTags:
    """A valve's name and the tag of each role the source should deliver. OP is required."""

    valve: str
    tags: Mapping[Role, TagMapping]


@dataclass(frozen=True, kw_only=True)
class Window:
    """A time window, both ends timezone aware; ``None`` is open."""

    start: datetime | None = None
    stop: datetime | None = None

    def __post_init__(self) -> None:
        for name, instant in (("start", self.start), ("stop", self.stop)):
            if instant is not None and instant.tzinfo is None:
                raise ValueError(f"window {name} must be timezone aware, received {instant}")


WHOLE = Window()
# Names of facts of a tag: the engineering values at 0 % and 100 %, where the source knows them.
RANGE_LOW, RANGE_HIGH = "range_low", "range_high"


@dataclass(frozen=True, kw_only=True)
class TagInfo:
    """One tag of a source: unit, description, samples, and the role and valve proposed for it."""

    tag: str
    unit: str = ""
    description: str = ""
    samples: int = 0
    proposed_role: Role | None = None  # only where tag and description leave no doubt
    proposed_valve: str = ""  # the loop that the tag seems to belong to
    remark: str = ""  # why a role was or was not proposed
    facts: Mapping[str, float] = field(default_factory=dict)  # RANGE_LOW, own_interval_s, ...


@runtime_checkable
class Connector(Protocol):
    """One source of recordings, opened and ready.

    An implementation must
    1. list its tags without reading more than it has to,
    2. give one ``Recording`` for a valve's tags and a window: percent of span where ranges are
       given, one even clock, UTC, bad samples masked with their reason, nothing interpolated,
    3. raise ``UnknownTag`` for a tag it does not have and ``ConnectorError`` for what it cannot
       read, and never return samples outside the window,
    4. only ever read.
    """

    def tags(self) -> Sequence[TagInfo]: ...

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording: ...


class ArchiveConnector(Connector, Protocol):
    """A connector that may hold thousands of tags."""

    def present(self, valve: ValveTags) -> ValveTags:
        """``valve`` without the roles whose tag the archive does not have.

        OP and MV stay asked for: that the position is missing is worth saying.
        """
        ...


@runtime_checkable
class ArchiveAddress(Protocol):
    """How to open an archive: hashable, picklable, and printed without secrets.

    A task carries the address, and the worker reads the samples.
    """

    def open(self) -> ArchiveConnector: ...

    def __hash__(self) -> int: ...
