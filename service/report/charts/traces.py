"""Traces, panels and charts as compact plain types, the parts of every chart of a valve.

A trace is sent as short whole numbers in letters, which keeps a page with a hundred valves small.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats, Recording, Role, Signal
from stemwatch.service.presenter.wording import figure, printable
from stemwatch.service.report.charts.thinning import (
    ThinningGrid,
    bucket_of,
    extreme_samples,
    lowest_and_highest,
)
from stemwatch.service.report.charts.typical_stretch import TypicalStretch, typical_stretch_of

# Four digits of what a trace spans: 1/10 pixel of the tallest plot, and half the file size.
DIGITS_OF_RANGE = 4
GAP = "~"
_ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"
_LETTERS = np.frombuffer(_ALPHABET.encode(), dtype=np.uint8).astype(np.int64)


def packed(values: Floats) -> dict[str, Any]:
    """``values`` rounded to visible resolution, as whole differences from sample to sample in
    ``step_text``.

    A value is the sum of ``steps`` up to it, divided by ``per``; a gap adds nothing.
    """
    finite = np.isfinite(values)
    places = _places(values[finite])
    integers = np.round(values[finite] * 10.0**places).astype(np.int64)
    return {"per": 10**places, "steps": step_text(integers, finite)}


def unpacked(trace: dict[str, Any]) -> Floats:
    """(n,) what ``packed`` kept; NaN at gaps. Pictures that were stored by earlier versions hold
    the steps as a list, ``None`` at gaps.
    """
    told = trace["steps"]
    steps = _steps_of(told) if isinstance(told, str) else told
    numbers = np.array([np.nan if step is None else step for step in steps], np.float64)
    return np.asarray(np.where(np.isnan(numbers), np.nan, np.nancumsum(numbers) / trace["per"]))


def packed_indices(indices: NDArray[np.intp]) -> dict[str, Any]:
    """Sample numbers, exact, in the form of ``packed``."""
    known = np.ones(indices.size, dtype=np.bool_)
    return {"per": 1, "steps": step_text(indices.astype(np.int64), known)}


def step_text(numbers: NDArray[np.int64], known: Bools) -> str:
    """The differences of whole numbers as base64 VLQ, as source maps write them: five bits a
    letter, the lowest first, 32 added where more follow; a negative difference d is written as
    -2 d - 1 and another as 2 d. That takes half the room of the same numbers in JSON.

    ``known`` (n,) is true where there is one of the k ``numbers`` (k,). A run of gaps is ``GAP``
    and its length, as if that were a difference.
    """
    steps = numbers - np.concatenate([[0], numbers[:-1]])
    edges = np.flatnonzero(np.diff(~known, prepend=False, append=False))
    first, runs = edges[::2], np.diff(edges)[::2]
    places = np.concatenate([np.flatnonzero(known), first])
    order = np.argsort(places, kind="stable")
    left = np.concatenate([np.where(steps < 0, -2 * steps - 1, 2 * steps), 2 * runs])[order]
    is_gap = (np.arange(left.size) >= steps.size)[order]
    columns = [np.where(is_gap, ord(GAP), 0)]
    more = np.ones(left.size, dtype=np.bool_)
    while more.any():
        low, left, present = left & 31, left >> 5, more
        more = present & (left > 0)
        columns.append(np.where(present, _LETTERS[np.where(more, low + 32, low)], 0))
    letters = np.stack(columns, axis=1).ravel()
    return letters[letters > 0].astype(np.uint8).tobytes().decode("ascii")


def _steps_of(text: str) -> list[int | None]:
    """What ``step_text`` was given, ``None`` at gaps."""
    steps: list[int | None] = []
    gap, number, shift = False, 0, 0
    for letter in text:
        if letter == GAP:
            gap = True
            continue
        digit = _ALPHABET.index(letter)
        number += (digit & 31) << shift
        shift += 5
        if digit >= 32:
            continue
        step = -(number + 1) // 2 if number % 2 else number // 2
        steps += [None] * step if gap else [step]
        gap, number, shift = False, 0, 0
    return steps


def _places(finite: Floats) -> int:
    """Decimals that keep ``DIGITS_OF_RANGE`` digits of the range of ``finite``."""
    if not finite.size:
        return 0
    size = float(np.ptp(finite)) or abs(float(finite[0])) or 1.0
    return min(12, max(0, DIGITS_OF_RANGE - 1 - math.floor(math.log10(size))))


SIGNALS = (Role.OP, Role.MV, Role.PV)

Chart = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class ChartFrame:
    """At which samples the traces of one recording are drawn: everywhere, and in the stretch."""

    grid: ThinningGrid
    stretch: TypicalStretch | None
    detail: NDArray[np.intp] | None


def frame_of(recording: Recording, simulated: Floats | None, heldout: int | None) -> ChartFrame:
    """The frame of a recording; the stretch is chosen by the free run ``simulated`` (n,)."""
    grid, stretch = (
        ThinningGrid.of(len(recording)),
        typical_stretch_of(recording, simulated, heldout),
    )
    if stretch is None or grid.bucket == 1:
        return ChartFrame(grid=grid, stretch=stretch, detail=None)
    signal_values = [
        recording.signals[role].values for role in SIGNALS if role in recording.signals
    ]
    if simulated is not None:
        signal_values.append(simulated)
    part = [trace[stretch.first : stretch.last] for trace in signal_values]
    if bucket_of(part[0].size, len(part)) >= grid.bucket:
        return ChartFrame(grid=grid, stretch=stretch, detail=None)
    return ChartFrame(grid=grid, stretch=stretch, detail=stretch.first + extreme_samples(part))


def chart_over_time(
    recording: Recording, frame: ChartFrame, heldout: int | None, panels: list[Chart | None]
) -> Chart:
    """A chart of ``panels`` without a loop; its fields stand in ``charts``."""
    grid = frame.grid
    return {
        "start": None if recording.start is None else recording.start.timestamp(),
        "first": grid.first * recording.interval_s,
        "step": grid.step * recording.interval_s,
        "interval": recording.interval_s,
        "duration": recording.duration_s,
        "heldout": None if heldout is None else heldout * recording.interval_s,
        "stretch": _stretch(frame.stretch, recording.interval_s),
        "detail": None if frame.detail is None else packed_indices(frame.detail),
        "panels": [panel for panel in panels if panel is not None],
        "loop": None,
        "thinned": grid.bucket,
    }


def _stretch(stretch: TypicalStretch | None, interval_s: float) -> Chart | None:
    if stretch is None:
        return None
    last = (stretch.last - 1) * interval_s
    first = stretch.first * interval_s
    return {"name": stretch.name, "from": first, "to": last, "why": stretch.why}


def difference(mv: Signal, simulated: Floats) -> Floats:
    """MV less a free run; raises ``ValueError`` where that is not as long as MV."""
    if simulated.shape != mv.values.shape:
        raise ValueError(
            f"{mv.tag}: a simulated trace must be as long as MV; "
            f"expected {mv.values.shape}, received {simulated.shape}"
        )
    return np.asarray(mv.values - simulated)


def series(role: str, label: str, values: Floats, frame: ChartFrame) -> Chart:
    """One trace: thinned over the whole record, sample by sample in the stretch."""
    thinned = lowest_and_highest(values, frame.grid)
    trace = {
        "role": role,
        "label": label,
        "said": _range(label, thinned),
        "values": packed(thinned),
    }
    if frame.detail is not None:
        trace["detail"] = packed(values[frame.detail])
    return trace


def panel(name: str, title: str, unit: str, traces: list[Chart]) -> Chart:
    """One plot over time, with a sentence for those who do not see it."""
    description = "; ".join(trace.pop("said") for trace in traces)
    return {
        "id": name,
        "title": title,
        "unit": printable(unit),
        "summary": f"{title} over time: {description}.",
        "series": traces,
    }


def _range(label: str, values: Floats) -> str:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return f"{label} has no samples"
    return f"{label} between {figure(finite.min())} and {figure(finite.max())}"
