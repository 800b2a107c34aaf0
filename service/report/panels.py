"""The parts that every chart of a valve is made of: when traces are drawn, series, panels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.service.report.decimate import (
    Grid,
    bucket_of,
    lowest_and_highest,
    telling_samples,
)
from stemwatch.service.report.pack import packed, packed_indices
from stemwatch.service.report.stretch import Stretch, stretch_of
from stemwatch.service.report.words import figure, printable

SIGNALS = (Role.OP, Role.MV, Role.PV)

Chart = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Frame:
    """At which samples the traces of one recording are drawn: everywhere, and in the stretch."""

    grid: Grid
    stretch: Stretch | None
    detail: NDArray[np.intp] | None


def frame_of(recording: Recording, simulated: Floats | None, heldout: int | None) -> Frame:
    """The frame of a recording; the stretch is chosen by the free run ``simulated`` (n,)."""
    grid, stretch = Grid.of(len(recording)), stretch_of(recording, simulated, heldout)
    if stretch is None or grid.bucket == 1:
        return Frame(grid=grid, stretch=stretch, detail=None)
    drawn = [recording.signals[role].values for role in SIGNALS if role in recording.signals]
    if simulated is not None:
        drawn.append(simulated)
    part = [trace[stretch.first : stretch.last] for trace in drawn]
    if bucket_of(part[0].size, len(part)) >= grid.bucket:
        return Frame(grid=grid, stretch=stretch, detail=None)
    return Frame(grid=grid, stretch=stretch, detail=stretch.first + telling_samples(part))


def chart_over_time(
    recording: Recording, frame: Frame, heldout: int | None, panels: list[Chart | None]
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


def _stretch(stretch: Stretch | None, interval_s: float) -> Chart | None:
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


def series(role: str, label: str, values: Floats, frame: Frame) -> Chart:
    """One trace: thinned over the whole record, sample by sample in the stretch."""
    drawn = lowest_and_highest(values, frame.grid)
    one = {"role": role, "label": label, "said": _range(label, drawn), "values": packed(drawn)}
    if frame.detail is not None:
        one["detail"] = packed(values[frame.detail])
    return one


def panel(name: str, title: str, unit: str, traces: list[Chart]) -> Chart:
    """One plot over time, with a sentence for those who do not see it."""
    spoken = "; ".join(one.pop("said") for one in traces)
    return {
        "id": name,
        "title": title,
        "unit": printable(unit),
        "summary": f"{title} over time: {spoken}.",
        "series": traces,
    }


def _range(label: str, values: Floats) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return f"{label} has no samples"
    return f"{label} between {figure(known.min())} and {figure(known.max())}"
