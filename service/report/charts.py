"""What the plots of one valve draw, as compact plain types for the page's scripts.

start      epoch seconds of sample 0, or null where the date is not known
first,step seconds from sample 0 to the first point, and from point to point
heldout    seconds from sample 0 to the part that no model was fitted to, or null
panels     [{id, title, unit, summary, series: [{role, label, values}]}], one even clock
loop       {title, x, y, seconds, op, traces: [{role, label, values}]} or null
thinned    samples a point stands for, 1 where every sample is drawn
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.findings import Screening
from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.service.report.decimate import Grid, lowest_and_highest, telling_samples
from stemwatch.service.report.words import figure, printable

# Four digits of what a trace spans: 1/10 pixel of the tallest plot, and half the file size.
DIGITS_OF_RANGE = 4

Chart = dict[str, Any]


def chart_of(screening: Screening) -> Chart | None:
    """The plots of ``screening``; ``None`` where there is no recording or no sample to draw."""
    recording = screening.recording
    if recording is None or not len(recording) or not np.isfinite(recording.op.values).any():
        return None
    grid = Grid.of(len(recording))
    heldout = screening.traces.heldout_from
    panels = [
        _travel(screening, recording, grid),
        _process(recording, grid),
        _residuals(screening, recording, grid),
    ]
    return {
        "start": None if recording.start is None else recording.start.timestamp(),
        "first": grid.first * recording.interval_s,
        "step": grid.step * recording.interval_s,
        "heldout": None if heldout is None else heldout * recording.interval_s,
        "panels": [panel for panel in panels if panel is not None],
        "loop": _loop(screening, recording),
        "thinned": grid.bucket,
    }


def _travel(screening: Screening, recording: Recording, grid: Grid) -> Chart:
    series = [_series("op", "OP", recording.op.values, grid)]
    if recording.mv is not None:
        series.append(_series("mv", "MV", recording.mv.values, grid))
    if screening.traces.stiction is not None:
        label = "stick-slip model"
        series.append(_series("stiction", label, screening.traces.stiction, grid))
    title = "Controller output and stem" if len(series) > 1 else "Controller output"
    return _panel("travel", title, "%", series)


def _process(recording: Recording, grid: Grid) -> Chart | None:
    pv, sp = recording.get(Role.PV), recording.get(Role.SP)
    shown = [(role, signal) for role, signal in (("pv", pv), ("sp", sp)) if signal is not None]
    if pv is None:
        return None
    series = [_series(role, role.upper(), signal.values, grid) for role, signal in shown]
    return _panel("process", "Process", pv.unit, series)


def _residuals(screening: Screening, recording: Recording, grid: Grid) -> Chart | None:
    mv, traces = recording.mv, screening.traces
    if mv is None:
        return None
    models = (
        ("stiction", "MV − stick-slip model", traces.stiction),
        ("narx", "MV − NARX network", traces.narx),
    )
    series = [
        _series(role, label, _difference(mv, simulated), grid)
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


def _series(role: str, label: str, values: Floats, grid: Grid) -> Chart:
    drawn = lowest_and_highest(values, grid)
    return {"role": role, "label": label, "said": _range(label, drawn), "values": _packed(drawn)}


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
    picked = telling_samples(drawn)
    labels = (("recorded", "recorded"), ("stiction", "stick-slip model"))
    return {
        "title": f"{name} against OP",
        "x": "OP, %",
        "y": f"{name}, {printable(vertical.unit)}".rstrip(", "),
        "seconds": _packed(recording.time_s[picked]),
        "op": _packed(op[picked]),
        "traces": [
            {"role": role, "label": label, "values": _packed(trace[picked])}
            for (role, label), trace in zip(labels, drawn[1:], strict=False)
        ],
    }


def _packed(values: Floats) -> Chart:
    """Rounded to what can be seen, as whole steps from sample to sample: half the file's size.

    A value is the sum of ``steps`` up to it, divided by ``per``; null is a gap and adds nothing.
    """
    known = np.isfinite(values)
    places = _places(values[known])
    whole = np.round(values[known] * 10.0**places).astype(np.int64)
    steps: list[int | None] = [None] * values.size
    for place, step in zip(np.flatnonzero(known).tolist(), _steps(whole), strict=True):
        steps[place] = step
    return {"per": 10**places, "steps": steps}


def _steps(whole: NDArray[np.int64]) -> list[int]:
    steps: list[int] = np.diff(whole, prepend=0).tolist()
    return steps


def _places(known: Floats) -> int:
    """Decimals that keep ``DIGITS_OF_RANGE`` digits of the range of ``known``."""
    if not known.size:
        return 0
    size = float(np.ptp(known)) or abs(float(known[0])) or 1.0
    return min(12, max(0, DIGITS_OF_RANGE - 1 - math.floor(math.log10(size))))
