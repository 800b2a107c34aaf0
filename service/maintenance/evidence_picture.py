"""The evidence picture: OP and MV over time, and MV against OP with the stick band of S and J."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta, tzinfo

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.models.screening_result import Screening
from stemwatch.service.maintenance.drawing import (
    Drawing,
    DrawnArea,
    DrawnLine,
    DrawnText,
    Mark,
    Panel,
    span,
)
from stemwatch.service.presenter.wording import instant, printable
from stemwatch.service.report.charts.axes import equally_long
from stemwatch.service.report.charts.loop_shapes import BAND, CURVE, LoopShapes, loop_shapes
from stemwatch.service.report.charts.thinning import extreme_samples
from stemwatch.service.report.charts.typical_stretch import typical_stretch_of

WIDTH, HEIGHT = 515.0, 172.0
TOP, FOOT, LEFT = 24.0, 24.0, 26.0
LOOP_WIDTH = 138.0
POINTS = 280
LONGEST_S = 3600.0  # drawn where no typical stretch is found
OP_DASH, MODEL_DASH, LOOP_DASH = (4.0, 2.0), (1.0, 1.6), (5.0, 1.5, 1.0, 1.5)
NO_SAMPLES = "No picture: the samples of this window are not kept."
NOTHING_TO_DRAW = "No picture: the recording holds no sample of the controller output."


@dataclass(frozen=True)
class DrawnTrace:
    """One line over time: its name in the legend, its samples (m,), and how it is drawn."""

    name: str
    values: Floats
    width: float
    dash: tuple[float, ...] = ()


def picture_of(
    screening: Screening, recording: Recording | None, zone: tzinfo
) -> tuple[Drawing | None, str]:
    """The picture of ``recording`` and which part of it that is, times in ``zone``; or ``None`` and
    the reason why there is none."""
    if recording is None:
        return None, NO_SAMPLES
    if not np.isfinite(recording.op.values).sum() > 1:
        return None, NOTHING_TO_DRAW
    simulated = simulated_run(screening, recording)
    part, reason = part_drawn(recording, simulated)
    reason += _from(recording, part, zone)
    has_position = recording.mv is not None
    width = WIDTH - LEFT - (LOOP_WIDTH + 44.0 if has_position else 0.0) - 6.0
    marks, caption = _over_time(recording, simulated, part, width)
    if has_position:
        marks += _against_op(screening, recording, part)
        caption += " Beside it MV against OP, with the stick band of S and J."
        if screening.stroke_curve is not None:
            caption += " The curve from OP to stroke goes through it."
    return Drawing(width=WIDTH, height=HEIGHT, marks=tuple(marks), caption=caption), reason


def simulated_run(screening: Screening, recording: Recording) -> Floats | None:
    """The model's free run where it was kept, with what was left out where that was named."""
    mismatch = screening.mismatch
    run = screening.traces.stiction
    if mismatch is not None and mismatch.runs is not None and mismatch.effects:
        run = mismatch.runs.extended
    return run if run is not None and run.shape == recording.op.values.shape else None


def part_drawn(recording: Recording, simulated: Floats | None) -> tuple[slice, str]:
    """The samples that are drawn, and a sentence that says which."""
    stretch = typical_stretch_of(recording, simulated, None)
    if stretch is not None:
        return slice(stretch.first, stretch.last), f"{stretch.name} of the record"
    longest = max(2, round(LONGEST_S / recording.interval_s))
    if len(recording) <= longest:
        return slice(0, len(recording)), "The whole record"
    finite = np.flatnonzero(np.isfinite(recording.op.values))
    last = int(finite[-1]) + 1
    return slice(max(0, last - longest), last), "The last hour of the record"


def _over_time(
    recording: Recording, simulated: Floats | None, part: slice, width: float
) -> tuple[list[Mark], str]:
    """OP dashed, MV (or PV on a panel below) solid, the model dotted."""
    op, mv, pv = recording.op, recording.mv, recording.get(Role.PV)
    traces = [DrawnTrace("OP", op.values[part], 0.7, OP_DASH)]
    if simulated is not None:
        traces.append(DrawnTrace("model", simulated[part], 1.0, MODEL_DASH))
    if mv is not None:
        traces.append(DrawnTrace("MV", mv.values[part], 1.2))
    pv_signal = None
    if mv is None and pv is not None and np.isfinite(pv.values[part]).any():
        pv_signal = pv.in_process_unit()
    unit = op.unit if mv is None or mv.unit == op.unit else f"{op.unit}, {mv.unit}"
    height = HEIGHT - TOP - FOOT - (66.0 if pv_signal is not None else 0.0)
    marks = _panel_over_time(recording, part, traces, unit, TOP, (width, height))
    if pv_signal is not None:
        drawn_traces = [DrawnTrace("PV", pv_signal.values[part], 1.2)]
        marks += _panel_over_time(
            recording, part, drawn_traces, pv_signal.unit, TOP + height + 36.0, (width, 30.0)
        )
    names = ", ".join(trace.name for trace in traces)
    return marks, f"{names} over time."


def _panel_over_time(
    recording: Recording,
    part: slice,
    traces: Sequence[DrawnTrace],
    unit: str,
    top: float,
    size: tuple[float, float],
) -> list[Mark]:
    seconds = recording.time_s[part] - recording.time_s[part.start]
    scale, time_unit = (60.0, "min") if seconds[-1] > 300.0 else (1.0, "s")
    low, high = span(*[trace.values for trace in traces])
    panel = Panel(
        left=LEFT,
        top=top,
        width=size[0],
        height=size[1],
        x0=0.0,
        x1=max(float(seconds[-1]) / scale, recording.interval_s / scale),
        y0=low,
        y1=high,
    )
    marks = panel.frame(time_unit, printable(unit))
    kept_samples = extreme_samples([trace.values for trace in traces], POINTS * len(traces))
    for trace in traces:
        marks += panel.lines(
            seconds[kept_samples] / scale, trace.values[kept_samples], trace.width, trace.dash
        )
    return marks + _legend(traces, top)


def _from(recording: Recording, part: slice, zone: tzinfo) -> str:
    if recording.start is None:
        return "."
    first = recording.start + timedelta(seconds=part.start * recording.interval_s)
    return f", from {instant(first, zone)}."


def _legend(traces: Sequence[DrawnTrace], top: float) -> list[Mark]:
    marks: list[Mark] = []
    x = LEFT + 20.0
    for trace in traces:
        marks.append(DrawnLine(((x, top - 7.0), (x + 22.0, top - 7.0)), trace.width, trace.dash))
        marks.append(DrawnText((x + 25.0, top - 4.7), trace.name, 7.0))
        x += 34.0 + 5.0 * len(trace.name)
    return marks


def _against_op(screening: Screening, recording: Recording, part: slice) -> list[Mark]:
    assert recording.mv is not None
    op, mv = recording.op.values[part], recording.mv.values[part]
    comparable = recording.mv.unit == recording.op.unit
    shapes = loop_shapes(screening, op, mv) if comparable else LoopShapes()
    band, curve = shapes.band, shapes.curve
    lines = [shape for shape in (band, curve) if shape is not None]
    (x0, x1) = span(op, *(shape[:, 0] for shape in lines))
    (y0, y1) = span(mv, *(shape[:, 1] for shape in lines))
    if comparable:
        (x0, x1), (y0, y1) = equally_long((x0, x1), (y0, y1), LOOP_WIDTH / (HEIGHT - TOP - FOOT))
    panel = Panel(
        left=WIDTH - LOOP_WIDTH - 4.0,
        top=TOP,
        width=LOOP_WIDTH,
        height=HEIGHT - TOP - FOOT,
        x0=x0,
        x1=x1,
        y0=y0,
        y1=y1,
    )
    marks = panel.frame("OP, %", "MV, %")
    if band is not None:
        corners = tuple(panel.at(float(x), float(y)) for x, y in band)
        marks.append(DrawnArea(corners, hatch=5.0))
        marks.append(DrawnLine((*corners, corners[0]), width=1.0, dash=LOOP_DASH))
        marks += _band_legend(panel)
    if curve is not None:
        line = tuple(panel.at(float(x), float(y)) for x, y in curve)
        marks.append(DrawnLine(line, width=1.3, dash=OP_DASH))
        marks += _curve_legend(panel)
    marks += _recorded_legend(panel, lines_below=(band is not None) + (curve is not None))
    kept_samples = extreme_samples([op, mv], 2 * POINTS)
    return marks + panel.lines(op[kept_samples], mv[kept_samples], 0.8)


def _recorded_legend(panel: Panel, lines_below: int) -> list[Mark]:
    x, y = panel.left + 24.0, panel.top - 7.0 - 8.0 * lines_below
    return [
        DrawnLine(((x, y), (x + 14.0, y)), width=0.8),
        DrawnText((x + 18.0, y + 2.3), "recorded", 7.0),
    ]


def _band_legend(panel: Panel) -> list[Mark]:
    x, y = panel.left + 24.0, panel.top - 7.0
    box = ((x, y - 4.0), (x + 14.0, y - 4.0), (x + 14.0, y + 3.0), (x, y + 3.0))
    return [
        DrawnArea(box, hatch=3.0),
        DrawnLine((*box, box[0]), width=0.8, dash=LOOP_DASH),
        DrawnText((x + 18.0, y + 2.3), BAND, 7.0),
    ]


def _curve_legend(panel: Panel) -> list[Mark]:
    x, y = panel.left + 24.0, panel.top - 15.0
    return [
        DrawnLine(((x, y), (x + 14.0, y)), width=1.3, dash=OP_DASH),
        DrawnText((x + 18.0, y + 2.3), CURVE, 7.0),
    ]
