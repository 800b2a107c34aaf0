"""``RawTable``: what a layout makes of a file, still as text, before anything is converted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.connectors.historian.values.quality_codes import Family

Index = NDArray[np.int64] | NDArray[np.int32]


@dataclass(frozen=True, kw_only=True)
class RawTimes:
    """The time of each row as text. ``texts`` is ``None`` where the file has no times at all."""

    texts: Sequence[str] | None
    name: str = ""  # the header of the column
    milliseconds: Sequence[str] | None = None  # a column of its own, to be added
    day_first: bool | None = None  # what the layout's product writes, where it is documented


@dataclass(frozen=True, kw_only=True)
class RawColumn:
    """One tag's cells. ``rows`` are the table's rows they stand on; ``None`` is every row."""

    tag: str
    cells: Sequence[str]
    unit: str = ""
    description: str = ""
    rows: Index | None = None
    quality_codes: Sequence[str] | None = None  # as long as ``cells``
    quality_name: str = "Quality"
    quality_family: Family = "unknown"
    held: Sequence[str] | None = None  # cells equal to 1 mark a value the archive repeated


@dataclass(frozen=True, kw_only=True)
class RawTable:
    """One file, understood but not converted."""

    layout: str  # in words, for the provenance
    times: RawTimes
    columns: Sequence[RawColumn]
    numbers: Sequence[int]  # line number of each row
    separator: str
    interval_s: float | None = None  # said by the file itself
    interval_name: str = ""  # the header of the column that says it
    narrow: bool = False  # each tag has its own times
    decimal: str | None = None  # where the format fixes it
    mv_is_output: bool = False  # the layout's own convention: MV is the manipulated variable
