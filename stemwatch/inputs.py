"""DataFrames, arrays, files and recordings, as callers pass them, to ``Recording``s."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace

import pandas as pd

from stemwatch.connectors.connector import ConnectorError
from stemwatch.given_files import all_of_path, one_of_file
from stemwatch.given_frames import of_arrays, of_frame
from stemwatch.input_options import EXPECTED, InputOptions, described
from stemwatch.models.recording import Provenance, Recording
from stemwatch.models.screening_result import Screening


def one_recording(data: object, inputs: InputOptions) -> Recording:
    """The single recording in ``data``.

    Raises ``ConnectorError`` where it cannot be read, ``MappingNeeded`` (a ``ConnectorError``)
    where it holds several valves and none was chosen, ``TypeError`` for data of another type.
    """
    if isinstance(data, str | os.PathLike):
        return one_of_file(os.fsdecode(data), inputs)
    if isinstance(data, Recording):
        if inputs != InputOptions():
            raise ValueError(
                "a Recording has its signals and its clock; op=, interval_s= and the like go with "
                "frames, arrays and files. recording.part(first, last) cuts it"
            )
        return data
    if data is None:
        return of_arrays(inputs)
    if is_several(data):
        raise TypeError(
            f"received {described(data)} of several, and a Recording is of one valve; read each "
            "of them, or hand the whole to stemwatch.screen or stemwatch.explain"
        )
    if not isinstance(data, pd.DataFrame):
        raise TypeError(f"received {described(data)}; {EXPECTED}")
    if inputs.arrays:
        raise ValueError(
            f"{', '.join(role.value for role in inputs.arrays)}: beside a DataFrame expected the "
            "name of a column; leave the frame out to hand over arrays"
        )
    return of_frame(data, inputs)


def several(data: object, inputs: InputOptions) -> list[Recording | Screening]:
    """Every recording of a path, a list or a dict, in order; one that cannot be read is a
    screening with the reason."""
    if isinstance(data, str | os.PathLike):
        return all_of_path(os.fsdecode(data), inputs)
    named = data.items() if isinstance(data, Mapping) else [("", item) for item in _as_list(data)]
    recordings: list[Recording | Screening] = []
    for index, (name, item) in enumerate(named):
        if isinstance(item, str | os.PathLike):
            recordings += [
                _renamed(recording, name) for recording in all_of_path(os.fsdecode(item), inputs)
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
    raise TypeError(f"received {described(data)}; {EXPECTED}")


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
        raise TypeError(f"{label} is {described(frame)}; {EXPECTED}")
    try:
        return one_recording(frame, replace(inputs, valve=name) if name else inputs)
    except ConnectorError as error:
        advice = "Correct the frame or the names of its columns; the other valves are not affected."
        return failed(
            name or f"entry {position}", str(error), advice, Provenance(source="DataFrame")
        )


def _renamed(recording: Recording | Screening, name: object) -> Recording | Screening:
    return replace(recording, valve=str(name)) if name else recording
