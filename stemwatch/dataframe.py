"""``DataFrameSource``: a pandas DataFrame as a source, read by the same rules as other
connectors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from stemwatch.connectors.archive.number_column import number_column
from stemwatch.connectors.archive.valve_columns import (
    ValveColumns,
    bounds_of,
    empty_column,
    need_samples,
    within_bounds,
)
from stemwatch.connectors.connector import (
    WHOLE,
    ConnectorError,
    TagInfo,
    UnreadableSource,
    ValveTags,
    Window,
)
from stemwatch.connectors.historian.columns import Column, convert
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.raw_table import RawColumn
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.recordings import assemble, find_tag, need_op
from stemwatch.connectors.historian.tags.roles import propose_roles
from stemwatch.connectors.historian.times.instants import Instants, local_instants, undated
from stemwatch.connectors.historian.values.units import split_unit
from stemwatch.models.recording import Recording, Role

NO_TIMES = (
    "{where}: the index holds no times (it is {found}); expected a DatetimeIndex or a "
    "TimedeltaIndex. {cure}"
)


class DataFrameSource:
    """A DataFrame with a row for each instant and a column for each tag.

    The index holds the times; without times ``interval_s`` says how many seconds lie between rows.
    Times without a zone are local times of ``zone``, or of an unknown date without one. Implements
    ``stemwatch.connectors.connector.Connector``; the frame is only ever read.
    """

    def __init__(
        self,
        frame: pd.DataFrame,
        *,
        where: str = "DataFrame",
        zone: str | None = None,
        interval_s: float | None = None,
    ) -> None:
        self.where = where
        self._options = ReadOptions(zone=zone, interval_s=interval_s)
        self._frame = frame
        self._places = _places(frame, where)
        self._notes = ReadingNotes()
        self._instants = self._read_times()

    def tags(self) -> Sequence[TagInfo]:
        """Every column with its unit and, where its name leaves no doubt, its role and valve."""
        named = [(tag, split_unit(tag)[1], "", None) for tag in self._places]
        return [
            tag.info(int(self._frame.iloc[:, self._places[tag.tag]].notna().sum()))
            for tag in propose_roles(named, stem="valve", mv_is_output=False)
        ]

    def read(self, valve: ValveTags, window: Window = WHOLE) -> Recording:
        """The recording of one valve.

        Raises ``UnknownTag`` with the nearest names for a column that is not there, and
        ``ConnectorError`` for one column given as both OP and MV, an OP without numbers, a window
        without samples, or a window where the date of the rows is not known.
        """
        need_op(self.where, valve)
        bounds = bounds_of(window)
        if bounds != (None, None) and not self._instants.in_utc:
            raise ConnectorError(
                f"{self.where}: start or stop was given, but the times have no zone; say zone, "
                "such as 'Europe/Berlin', or cut the frame yourself"
            )
        recordings = self._loaded({tag: empty_column(tag) for tag in self._places})
        columns: dict[str, Column] = {}
        for role, mapping in valve.tags.items():
            tag = find_tag(recordings, mapping.tag)
            columns[tag] = within_bounds(self._column(tag, as_mode=role is Role.MODE), bounds)
            if role is Role.OP:
                need_samples(columns[tag], window, self.where, self._contents)
        return assemble(self._loaded(columns), valve, window)

    def _loaded(self, columns: Mapping[str, Column]) -> ValveColumns:
        return ValveColumns(
            source_name=self.where,
            layout="a table in memory, a column for each tag",
            columns=columns,
            in_utc=self._instants.in_utc,
            zone=self._instants.zone,
            decisions=self._notes.decisions,
            problems=self._notes.problems,
        )

    def _column(self, tag: str, *, as_mode: bool) -> Column:
        series = self._frame.iloc[:, self._places[tag]]
        unit, ns, ok = split_unit(tag)[1], self._instants.ns, self._instants.ok
        if pd.api.types.is_numeric_dtype(series.dtype):
            values = series.to_numpy(dtype=np.float64, na_value=np.nan)
            return number_column(
                tag, ns, ok, values, source_name=self.where, unit=unit, as_mode=as_mode
            )
        cells = ["" if pd.isna(cell) else str(cell) for cell in series]
        raw = RawColumn(tag=tag, cells=cells, unit=unit)
        return convert(raw, self._instants, decimal=".", good=(), name=self.where, as_mode=as_mode)

    def _read_times(self) -> Instants:
        index, interval_s = self._frame.index, self._options.interval_s
        if isinstance(index, pd.PeriodIndex):
            index = index.to_timestamp()
        if interval_s is not None:
            return self._row_instants(index, interval_s)
        if not isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex):
            raise UnreadableSource(
                NO_TIMES.format(where=self.where, found=_described(index), cure=self._advice())
            )
        ok = np.asarray(index.notna(), dtype=np.bool_)
        ns = np.where(ok, index.as_unit("ns").asi8, 0)
        if not ok.all():
            self._notes.problem(f"{int((~ok).sum())} rows have no time; they were left out")
        if isinstance(index, pd.TimedeltaIndex):
            return undated(ns, ok, self._notes)
        if index.tz is None:
            return local_instants(ns, ok, self._options, self._notes)
        return Instants(ns=ns, ok=ok, in_utc=True, zone="The times are instants in UTC.")

    def _row_instants(self, index: pd.Index, interval_s: float) -> Instants:
        if isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex):
            raise ValueError(
                f"{self.where}: interval_s={interval_s:g} was given, but the index holds times "
                f"(from {index[0] if len(index) else 'nothing'}); leave interval_s out, or hand "
                "over frame.reset_index(drop=True)"
            )
        self._notes.decide(f"There is no time column; the rows are {interval_s:g} s apart.")
        ns = np.round(np.arange(len(index)) * interval_s * 1e9).astype(np.int64)
        return Instants(ns=ns, ok=np.ones(len(index), dtype=np.bool_), in_utc=False, zone="")

    def _advice(self) -> str:
        """What to do about an index without times."""
        kinds = self._frame.dtypes
        for tag, column_index in self._places.items():
            if pd.api.types.is_datetime64_any_dtype(kinds.iloc[column_index]):
                return f"Column {tag!r} holds times: hand over frame.set_index({tag!r})."
        if pd.api.types.is_string_dtype(self._frame.index.dtype) and len(self._frame):
            return "Turn its texts into times: frame.index = pandas.to_datetime(frame.index)."
        return "Say interval_s, the seconds between rows, or set a column of times as the index."

    def _contents(self) -> str:
        index = self._frame.index
        if not len(index):
            return "the frame has no rows"
        return f"the frame covers {index[0]} to {index[-1]}"


def _places(frame: pd.DataFrame, where: str) -> dict[str, int]:
    """The position of each column by its name as text. Raises ``ValueError`` where two share one,
    or there is none."""
    names = [str(name) for name in frame.columns]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ValueError(f"{where}: each column needs a name of its own; twice: {repeated}")
    if not names:
        raise ValueError(f"{where}: the frame has no columns; expected one for OP at least")
    return {name: index for index, name in enumerate(names)}


def _described(index: pd.Index) -> str:
    if isinstance(index, pd.RangeIndex):
        return f"a RangeIndex of {len(index)} rows"
    beginning = f", beginning with {index[0]!r}" if len(index) else ""
    return f"of type {index.dtype}{beginning}"
