"""What the plots of one valve draw, as compact plain types for the page's scripts.

start      epoch seconds of sample 0, or null where the date is not known
first,step seconds from sample 0 to the first point, and from point to point
interval   seconds from sample to sample
duration   seconds from the first sample to just after the last
heldout    seconds from sample 0 to the part that no model was fitted to, or null
stretch    {name, from, to, why}, seconds from sample 0: what the plots open on, or null for all
detail     the samples of the stretch that are drawn one by one, or null where all samples are
panels     [{id, title, unit, summary, series: [{role, label, values, detail}]}], one even clock
loop       {title, x, y, seconds, op, traces: [{role, of, label, values}]} or null
thinned    samples a point stands for, 1 where every sample is drawn
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.findings import Screening
from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.service.report.decimate import (
    Grid,
    bucket_of,
    lowest_and_highest,
    telling_samples,
)
from stemwatch.service.report.pack import packed, packed_indices
from stemwatch.service.report.stretch import Stretch, typical_stretch
from stemwatch.service.report.words import figure, printable

# The loop of a whole record is a cloud with an outline; its stretch is drawn sample by sample.
LOOP_POINTS = 800

_SIGNALS = (Role.OP, Role.MV, Role.PV)

Chart = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class _Frame:
    """At which samples the traces of one recording are drawn: everywhere, and in the stretch."""

    grid: Grid
    stretch: Stretch | None
    detail: NDArray[np.intp] | None


def chart_of(screening: Screening) -> Chart | None:
    """The plots of ``screening``; ``None`` where there is no recording or no sample to draw."""
    recording = screening.recording
    if recording is None or not len(recording) or not np.isfinite(recording.op.values).any():
        return None
    frame = _frame(screening, recording)
    grid = frame.grid
    heldout = screening.traces.heldout_from
    panels = [
        _travel(screening, recording, frame),
        _process(recording, frame),
        _residuals(screening, recording, frame),
    ]
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
        "loop": _loop(screening, recording),
        "thinned": grid.bucket,
    }


def _frame(screening: Screening, recording: Recording) -> _Frame:
    grid, stretch = Grid.of(len(recording)), typical_stretch(screening)
    if stretch is None or grid.bucket == 1:
        return _Frame(grid=grid, stretch=stretch, detail=None)
    drawn = [recording.signals[role].values for role in _SIGNALS if role in recording.signals]
    if screening.traces.stiction is not None:
        drawn.append(screening.traces.stiction)
    part = [trace[stretch.first : stretch.last] for trace in drawn]
    if bucket_of(part[0].size, len(part)) >= grid.bucket:
        return _Frame(grid=grid, stretch=stretch, detail=None)
    return _Frame(grid=grid, stretch=stretch, detail=stretch.first + telling_samples(part))


def _stretch(stretch: Stretch | None, interval_s: float) -> Chart | None:
    if stretch is None:
        return None
    last = (stretch.last - 1) * interval_s
    first = stretch.first * interval_s
    return {"name": stretch.name, "from": first, "to": last, "why": stretch.why}


def _travel(screening: Screening, recording: Recording, frame: _Frame) -> Chart:
    series = [_series("op", "OP", recording.op.values, frame)]
    if recording.mv is not None:
        series.append(_series("mv", "MV", recording.mv.values, frame))
    if screening.traces.stiction is not None:
        label = "stick-slip model"
        series.append(_series("stiction", label, screening.traces.stiction, frame))
    title = "Controller output and stem" if len(series) > 1 else "Controller output"
    return _panel("travel", title, "%", series)


def _process(recording: Recording, frame: _Frame) -> Chart | None:
    pv, sp = recording.get(Role.PV), recording.get(Role.SP)
    shown = [(role, signal) for role, signal in (("pv", pv), ("sp", sp)) if signal is not None]
    if pv is None:
        return None
    series = [_series(role, role.upper(), signal.values, frame) for role, signal in shown]
    return _panel("process", "Process", pv.unit, series)


def _residuals(screening: Screening, recording: Recording, frame: _Frame) -> Chart | None:
    mv, traces = recording.mv, screening.traces
    if mv is None:
        return None
    models = (
        ("stiction", "MV − stick-slip model", traces.stiction),
        ("narx", "MV − NARX network", traces.narx),
    )
    series = [
        _series(role, label, _difference(mv, simulated), frame)
        for role, label, simulated in models
        if simulated is not None
    ]
    if not series:
        return None
    return _panel("residual", "What the models leave unexplained", "%", series)


def _difference(mv: Signal, simulated: Floats) -> Floats:
    if simulated.shape != mv.values.shape:
        raise ValueError(
            f"{mv.tag}: a simulated trace must be as long as MV; "
            f"expected {mv.values.shape}, received {simulated.shape}"
        )
    return np.asarray(mv.values - simulated)


def _series(role: str, label: str, values: Floats, frame: _Frame) -> Chart:
    drawn = lowest_and_highest(values, frame.grid)
    series = {"role": role, "label": label, "said": _range(label, drawn), "values": packed(drawn)}
    if frame.detail is not None:
        series["detail"] = packed(values[frame.detail])
    return series


def _panel(name: str, title: str, unit: str, series: list[Chart]) -> Chart:
    spoken = "; ".join(one.pop("said") for one in series)
    return {
        "id": name,
        "title": title,
        "unit": printable(unit),
        "summary": f"{title} over time: {spoken}.",
        "series": series,
    }


def _range(label: str, values: Floats) -> str:
    known = values[np.isfinite(values)]
    if not known.size:
        return f"{label} has no samples"
    return f"{label} between {figure(known.min())} and {figure(known.max())}"


def _loop(screening: Screening, recording: Recording) -> Chart | None:
    """The recorded points and the simulated path against OP; PV stands in where MV is absent."""
    vertical, name = recording.mv, "MV"
    if vertical is None:
        vertical, name = recording.get(Role.PV), "PV"
    if vertical is None:
        return None
    op, simulated = recording.op.values, screening.traces.stiction
    drawn = [op, vertical.values]
    if simulated is not None and name == "MV":
        drawn.append(simulated)
    picked = telling_samples(drawn, LOOP_POINTS)
    labels = (
        ("recorded", name.lower(), "recorded"),
        ("stiction", "stiction", "stick-slip model"),
    )
    return {
        "title": f"{name} against OP",
        "x": "OP, %",
        "y": f"{name}, {printable(vertical.unit)}".rstrip(", "),
        "seconds": packed(recording.time_s[picked]),
        "op": packed(op[picked]),
        "traces": [
            {"role": role, "of": of, "label": label, "values": packed(trace[picked])}
            for (role, of, label), trace in zip(labels, drawn[1:], strict=False)
        ],
    }
