"""DataFrames, arrays, files and recordings, as callers pass them, to ``Recording``s."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import TYPE_CHECKING, Any, TypedDict
from zoneinfo import ZoneInfo

import numpy as np
import numpy.typing as npt
import pandas as pd

from stemwatch.connectors.connector import (
    ConnectorError,
    MappingNeeded,
    TagMapping,
    ValveTags,
    Window,
)
from stemwatch.connectors.historian import ReadOptions, propose_valves
from stemwatch.connectors.historian.tags.tag_names import parse_tag
from stemwatch.connectors.settings import nearest
from stemwatch.dataframe import DataFrameSource
from stemwatch.models.recording import PERCENT, Provenance, Recording, Role
from stemwatch.models.screening_result import Screening
from stemwatch.models.words import listed
from stemwatch.service.run.plan import Request, make_plan
from stemwatch.service.run.task import Task, case_of

if TYPE_CHECKING:
    from stemwatch.models.screening.screen import Case

SignalInput = str | npt.ArrayLike
FilePath = str | os.PathLike[str]
OneValve = pd.DataFrame | Recording
EXPECTED = (
    "expected a pandas DataFrame, a Recording, the path of a file or folder, arrays as op= and mv= "
    "with interval_s=, or a list or dict of several"
)
_FRACTION = 1.0 + 1e-9
_MOST_NAMED = 12  # valves or tags of a message


class FileOptions(TypedDict, total=False):
    """Options for reading a file, where it should not be decided from its contents: see
    ``ReadOptions``."""

    ambiguous_hour: str
    missing_hour: str
    encoding: str
    separator: str
    decimal: str
    day_first: bool
    time_format: str
    time_column: str
    tag_column: str
    value_column: str
    quality_column: str
    good_quality: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class InputOptions:
    """The arguments of a call beside the data: signals, ranges, window, clock, reading options."""

    signals: Mapping[Role, SignalInput] = field(default_factory=dict)
    valve: str = ""
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    interval_s: float | None = None
    zone: str | None = None
    start: datetime | str | None = None
    stop: datetime | str | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def tags(self) -> dict[Role, str]:
        """The signals given as names of columns or tags, by role."""
        return {role: signal for role, signal in self.signals.items() if isinstance(signal, str)}

    @property
    def arrays(self) -> dict[Role, npt.ArrayLike]:
        """The signals given as arrays, by role."""
        return {
            role: signal for role, signal in self.signals.items() if not isinstance(signal, str)
        }

    @property
    def window(self) -> Window:
        """The window; times without a zone are local times of ``zone``."""
        return Window(start=self._aware("start", self.start), stop=self._aware("stop", self.stop))

    def mapping(self, role: Role, tag: str, unit: str = "") -> TagMapping:
        """The tag of ``role`` with the engineering values at 0 % and 100 %."""
        low, high = self.ranges.get(role.value, (None, None))
        return TagMapping(tag=tag, unit=unit, low=low, high=high)

    def _aware(self, name: str, given: datetime | str | None) -> datetime | None:
        moment = _instant(name, given) if isinstance(given, str) else given
        if moment is None or moment.tzinfo is not None:
            return moment
        if self.zone is None:
            raise ValueError(
                f"{name}={moment} has no zone; hand over an aware time, such as "
                "datetime(2026, 3, 2, 6, tzinfo=UTC), or say zone='Europe/Berlin'"
            )
        return moment.replace(tzinfo=ZoneInfo(self.zone))


def _instant(name: str, text: str) -> datetime:
    try:
        return datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(
            f"{name}={text!r} is no time; expected ISO text such as '2026-03-02 06:00', or a "
            "datetime"
        ) from None


def checked_options(
    signals: Mapping[str, SignalInput | None],
    valve: str,
    interval_s: float | None,
    zone: str | None,
    ranges: Mapping[str, tuple[float, float]] | None,
    start: datetime | str | None,
    stop: datetime | str | None,
    options: Mapping[str, Any],
) -> InputOptions:
    """The arguments after a check. Raises ``ValueError`` where they contradict one another."""
    signal_of_role = {Role(name): signal for name, signal in signals.items() if signal is not None}
    if signal_of_role and Role.OP not in signal_of_role:
        raise ValueError(
            f"{', '.join(role.value for role in signal_of_role)} given without op; say op=, the "
            "column or the samples of the controller output"
        )
    for name, pair in (ranges or {}).items():
        if name not in signals:
            raise ValueError(f"ranges: {name!r} is no signal; expected some of {list(signals)}")
        if len(tuple(pair)) != 2:
            raise ValueError(
                f"ranges[{name!r}] is {pair!r}; expected the values at 0 % and at 100 %, such as "
                "(4, 20) for mA or (0, 1) for a fraction"
            )
    return InputOptions(
        signals=signal_of_role,
        valve=valve,
        ranges=dict(ranges or {}),
        interval_s=interval_s,
        zone=zone,
        start=start,
        stop=stop,
        options=options,
    )


def one_recording(data: object, inputs: InputOptions) -> Recording:
    """The single recording in ``data``.

    Raises ``ConnectorError`` where it cannot be read, ``MappingNeeded`` (a ``ConnectorError``)
    where it holds several valves and none was chosen, ``TypeError`` for data of another type.
    """
    if isinstance(data, str | os.PathLike):
        return _one_of_file(os.fsdecode(data), inputs)
    if isinstance(data, Recording):
        if inputs != InputOptions():
            raise ValueError(
                "a Recording has its signals and its clock; op=, interval_s= and the like go with "
                "frames, arrays and files. recording.part(first, last) cuts it"
            )
        return data
    if data is None:
        return _of_arrays(inputs)
    if is_several(data):
        raise TypeError(
            f"received {_described(data)} of several, and a Recording is of one valve; read each "
            "of them, or hand the whole to stemwatch.screen or stemwatch.explain"
        )
    if not isinstance(data, pd.DataFrame):
        raise TypeError(f"received {_described(data)}; {EXPECTED}")
    if inputs.arrays:
        raise ValueError(
            f"{', '.join(role.value for role in inputs.arrays)}: beside a DataFrame expected the "
            "name of a column; leave the frame out to hand over arrays"
        )
    return _of_frame(data, inputs)


def several(data: object, inputs: InputOptions) -> list[Recording | Screening]:
    """Every recording of a path, a list or a dict, in order; one that cannot be read is a
    screening with the reason."""
    if isinstance(data, str | os.PathLike):
        return _of_path(os.fsdecode(data), inputs)
    named = data.items() if isinstance(data, Mapping) else [("", item) for item in _as_list(data)]
    recordings: list[Recording | Screening] = []
    for index, (name, item) in enumerate(named):
        if isinstance(item, str | os.PathLike):
            recordings += [
                _renamed(recording, name) for recording in _of_path(os.fsdecode(item), inputs)
            ]
        else:
            recordings.append(_one_or_reason(item, str(name), inputs, index))
    return recordings


def is_several(data: object) -> bool:
    """Whether ``data`` may hold more than one valve: a path, a list, a dict."""
    return isinstance(data, str | os.PathLike | list | tuple | Mapping)


def _as_list(data: object) -> Sequence[object]:
    if isinstance(data, list | tuple):
        return data
    raise TypeError(f"received {_described(data)}; {EXPECTED}")


def _one_or_reason(
    frame: object, name: str, inputs: InputOptions, position: int
) -> Recording | Screening:
    """The recording of an entry of a list or dict; a screening with the reason where it cannot be
    read."""
    from stemwatch.models.screening.screen import failed

    if isinstance(frame, Recording):
        return _renamed(frame, name)
    if not isinstance(frame, pd.DataFrame):
        label = repr(name) if name else f"entry {position}"
        raise TypeError(f"{label} is {_described(frame)}; {EXPECTED}")
    try:
        return one_recording(frame, replace(inputs, valve=name) if name else inputs)
    except ConnectorError as error:
        advice = "Correct the frame or the names of its columns; the other valves are not affected."
        return failed(
            name or f"entry {position}", str(error), advice, Provenance(source="DataFrame")
        )


def _renamed(recording: Recording | Screening, name: object) -> Recording | Screening:
    return replace(recording, valve=str(name)) if name else recording


def _of_path(path: str, inputs: InputOptions) -> list[Recording | Screening]:
    """Every valve of the files and folders that ``path`` names."""
    recordings: list[Recording | Screening] = []
    for task in _of_valve(path, _tasks(path, inputs), inputs):
        case: Case | Screening = case_of(task)
        recordings.append(case if isinstance(case, Screening) else _checked(case.recording, inputs))
    return recordings


def _tasks(path: str, inputs: InputOptions) -> list[Task]:
    """What there is to read in ``path``, with the ranges of the call."""
    if inputs.arrays:
        raise ValueError(
            f"{', '.join(role.value for role in inputs.arrays)}: beside a path expected the name "
            "of a tag; leave the path out to hand over arrays"
        )
    tags = inputs.tags
    request = Request(
        sources=(path,),
        tags=tags,
        valve=inputs.valve if tags else "",
        window=inputs.window,
        read_options=read_options(inputs),
    )
    planned = make_plan(request)
    tasks = []
    for task in planned.tasks:
        mapped = {
            role: inputs.mapping(role, tag.tag, tag.unit) if role.value in inputs.ranges else tag
            for role, tag in task.tags.tags.items()
        }
        tasks.append(replace(task, tags=replace(task.tags, tags=mapped)))
    return tasks


def _one_of_file(path: str, inputs: InputOptions) -> Recording:
    tasks = _tasks(path, inputs)
    chosen = _of_valve(path, tasks, inputs)
    if len(chosen) == 1:
        case: Case | Screening = case_of(chosen[0])
        if isinstance(case, Screening):
            raise ConnectorError(" ".join((case.quality.reasons[0], *case.still_seen)))
        return _checked(case.recording, inputs)
    names = [task.tags.valve for task in tasks]
    raise MappingNeeded(
        f"{path}: holds {len(names)} valves ({_name_list(names)}); say which with "
        f"valve={(names or ['FIC-101'])[0]!r}, or screen them all: stemwatch.screen({path!r})"
    )


def _of_valve(path: str, tasks: Sequence[Task], inputs: InputOptions) -> Sequence[Task]:
    """The tasks of the valve that the call names; all where it names none, or names the tags, when
    the name is a new one. Raises ``MappingNeeded`` for a valve that is not in ``path``."""
    if not inputs.valve or inputs.tags:
        return tasks
    chosen = [task for task in tasks if task.tags.valve == inputs.valve]
    if not chosen:
        names = [task.tags.valve for task in tasks]
        raise MappingNeeded(
            f"{path}: there is no valve {inputs.valve!r} among {len(names)}"
            f"{nearest(inputs.valve, names)}; expected one of {_name_list(names)}"
        )
    return chosen


def read_options(inputs: InputOptions) -> ReadOptions:
    """The reading options. Raises ``TypeError`` for one that does not exist."""
    option_names = set(FileOptions.__annotations__)
    for name in inputs.options:
        if name not in option_names:
            suggestion = nearest(name, option_names)
            raise TypeError(
                f"{name!r} is no option of reading{suggestion}; expected {sorted(option_names)}"
            )
    return ReadOptions(zone=inputs.zone, interval_s=inputs.interval_s, **inputs.options)


def _of_frame(frame: pd.DataFrame, inputs: InputOptions) -> Recording:
    if inputs.options:
        raise ValueError(f"{', '.join(inputs.options)}: how a file is read; a DataFrame is no file")
    table = DataFrameSource(frame, zone=inputs.zone, interval_s=inputs.interval_s)
    return _checked(table.read(_valve_tags(table, inputs), inputs.window), inputs)


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
            f"{table.where}: holds {len(names)} valves ({_name_list(names)}); say which with "
            f"valve={names[0]!r}, or name the columns with op= and mv=. To screen them all, hand "
            "over a dict of recordings: {name: stemwatch.read(frame, valve=name) for name in ...}"
        )
    raise MappingNeeded(
        f"{table.where}: which column is the controller output? Say op= and, where the position "
        f"is measured, mv=; the columns are {_name_list(list(columns))}"
    )


def _of_arrays(inputs: InputOptions) -> Recording:
    """The recording in arrays: a Series has its index as times, arrays need ``interval_s``."""
    if not inputs.signals:
        raise TypeError(f"received nothing; {EXPECTED}")
    if inputs.tags:
        raise ValueError(
            f"{', '.join(f'{role.value}={tag!r}' for role, tag in inputs.tags.items())} names a "
            "column or a "
            "tag, but no frame and no file was given; hand it over as the first argument"
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
    return _checked(table.read(valve, inputs.window), inputs)


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
            f"{role.value} is {_described(given)}; expected numbers, one for each sample"
        ) from error
    if values.ndim != 1:
        raise ValueError(
            f"{role.value}: expected one number for each sample, shape (n,); received shape "
            f"{values.shape}"
        )
    return values


def _checked(recording: Recording, inputs: InputOptions) -> Recording:
    """Warn where OP or MV looks like a fraction of 1; without ``ranges`` nothing is converted."""
    for role in (Role.OP, Role.MV):
        signal = recording.get(role)
        if signal is None or signal.unit != PERCENT or role.value in inputs.ranges:
            continue
        values = signal.values[np.isfinite(signal.values)]
        if values.size and 0.0 <= values.min() and values.max() <= _FRACTION and np.ptp(values):
            warnings.warn(
                f"{recording.valve}: {signal.tag} runs from {values.min():.3g} to "
                f"{values.max():.3g} and was taken as percent of span; if it is a fraction, say "
                f"ranges={{{role.value!r}: (0, 1)}}, if it is percent, (0, 100)",
                UserWarning,
                stacklevel=5,  # the caller of ``read``, or of ``screen`` for one valve
            )
    return recording


def _name_list(names: Sequence[str]) -> str:
    return listed([repr(name) for name in names], _MOST_NAMED) or "none"


def _described(value: object) -> str:
    kind = type(value)
    name = kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"
    shape = getattr(value, "shape", None)
    article = "an" if name[0] in "aeiou" else "a"
    return f"{article} {name}" + (f" of shape {shape}" if isinstance(shape, tuple) else "")
