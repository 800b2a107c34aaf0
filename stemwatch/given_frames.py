"""The recording of a DataFrame, or of arrays, as callers hand it over."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import pandas as pd

from stemwatch.connectors.connector import MappingNeeded, ValveTags
from stemwatch.connectors.historian import propose_valves
from stemwatch.connectors.historian.tags.tag_names import parse_tag
from stemwatch.dataframe import DataFrameSource
from stemwatch.input_options import EXPECTED, InputOptions, described, name_list, warned_of_fraction
from stemwatch.models.recording import Recording, Role


def of_frame(frame: pd.DataFrame, inputs: InputOptions) -> Recording:
    """The recording in a DataFrame. Raises ``MappingNeeded`` where its columns leave a doubt."""
    if inputs.options:
        raise ValueError(f"{', '.join(inputs.options)}: how a file is read; a DataFrame is no file")
    table = DataFrameSource(frame, zone=inputs.zone, interval_s=inputs.interval_s)
    return warned_of_fraction(table.read(_valve_tags(table, inputs), inputs.window), inputs)


def _valve_tags(table: DataFrameSource, inputs: InputOptions) -> ValveTags:
    """The named columns; else those called op, mv, ...; else those recognised by their names."""
    columns = {info.tag: info for info in table.tags()}
    named = inputs.tags or {role: role.value for role in Role if role.value in columns}
    if Role.OP in named:
        units = {tag: info.unit for tag, info in columns.items()}
        tags = {role: inputs.mapping(role, tag, units.get(tag, "")) for role, tag in named.items()}
        return ValveTags(valve=inputs.valve or parse_tag(named[Role.OP]).loop or "valve", tags=tags)
    proposed = propose_valves(table)
    if inputs.valve:
        proposed = [
            candidate for candidate in proposed if candidate.valve == inputs.valve
        ] or proposed
    if len(proposed) == 1:
        (only,) = proposed
        tags = {role: inputs.mapping(role, tag.tag, tag.unit) for role, tag in only.tags.items()}
        return ValveTags(valve=inputs.valve or only.valve, tags=tags)
    if proposed:
        names = [candidate.valve for candidate in proposed]
        raise MappingNeeded(
            f"{table.where}: holds {len(names)} valves ({name_list(names)}); say which with "
            f"valve={names[0]!r}, or name the columns with op= and mv=. To screen them all, hand "
            "over a dict of recordings: {name: stemwatch.read(frame, valve=name) for name in ...}"
        )
    raise MappingNeeded(
        f"{table.where}: which column is the controller output? Say op= and, where the position "
        f"is measured, mv=; the columns are {name_list(list(columns))}"
    )


def of_arrays(inputs: InputOptions) -> Recording:
    """The recording in arrays: a Series has its index as times, arrays need ``interval_s``."""
    if not inputs.signals:
        raise TypeError(f"received nothing; {EXPECTED}")
    if inputs.tags:
        raise ValueError(
            f"{', '.join(f'{role.value}={tag!r}' for role, tag in inputs.tags.items())} names a "
            "column or a tag, but no frame and no file was given; hand it over as the first "
            "argument"
        )
    signals = {role: _vector(role, array) for role, array in inputs.arrays.items()}
    series = [signal for signal in signals.values() if isinstance(signal, pd.Series)]
    lengths = {role.value: len(signal) for role, signal in signals.items()}
    if len(series) < len(signals) and len(set(lengths.values())) > 1:
        raise ValueError(f"arrays of one length expected, received {lengths}")
    timed = [column.index for column in series if not isinstance(column.index, pd.RangeIndex)]
    if not timed and inputs.interval_s is None:
        raise ValueError(
            "arrays bear no times; say interval_s=, the seconds between samples, or hand over "
            "pandas Series with a time index"
        )
    frame = _side_by_side(signals, timed[0] if timed else None)
    table = DataFrameSource(frame, where="arrays", zone=inputs.zone, interval_s=inputs.interval_s)
    tags = {role: inputs.mapping(role, role.value) for role in signals}
    valve = ValveTags(valve=inputs.valve or "valve", tags=tags)
    return warned_of_fraction(table.read(valve, inputs.window), inputs)


def _side_by_side(
    signals: Mapping[Role, pd.Series | npt.NDArray[np.float64]], index: pd.Index | None
) -> pd.DataFrame:
    """A frame with a column for each signal; Series are aligned by time, arrays by position."""
    columns = {
        role.value: signal if isinstance(signal, pd.Series) else pd.Series(signal, index=index)
        for role, signal in signals.items()
    }
    first = next(iter(columns.values())).index
    for name, column in columns.items():
        if not column.index.is_unique and any(
            not column.index.equals(other.index) for other in columns.values()
        ):
            raise ValueError(
                f"{name}: its times repeat, so that it cannot be laid beside the others; drop them "
                "with series[~series.index.duplicated()], or hand over one DataFrame"
            )
    if all(column.index.equals(first) for column in columns.values()):
        return pd.DataFrame(columns, index=first)
    return pd.concat(columns, axis="columns", sort=False)


def _vector(role: Role, given: npt.ArrayLike) -> pd.Series | npt.NDArray[np.float64]:
    if isinstance(given, pd.Series):
        return given
    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise TypeError(
            f"{role.value} is {described(given)}; expected numbers, one for each sample"
        ) from error
    if values.ndim != 1:
        raise ValueError(
            f"{role.value}: expected one number for each sample, shape (n,); received shape "
            f"{values.shape}"
        )
    return values
