"""What the plots of one valve draw, as compact plain types for the page's scripts.

start      epoch seconds of sample 0, or null where the date is not known
first,step seconds from sample 0 to the first point, and from point to point
interval   seconds from sample to sample
duration   seconds from the first sample to just after the last
heldout    seconds from sample 0 to the part that no model was fitted to, or null
stretch    {name, from, to, why}, seconds from sample 0: what the plots open on, or null for all
detail     the samples of the stretch that are drawn one by one, or null where all samples are
panels     [{id, title, unit, summary, series: [{role, label, values, detail}]}], one even clock
loop       {title, x, y, seconds, op, traces: [{role, of, label, values}], says,
           shapes: [{role, label, op, values}]} or null; shapes lie behind the traces
thinned    samples a point stands for, 1 where every sample is drawn
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.mismatch.findings import FreeRuns
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening_result import Screening
from stemwatch.models.without_position.picture import ElementTraces
from stemwatch.service.presenter.wording import printable
from stemwatch.service.report.charts.loop_shapes import LoopShapes, loop_shapes
from stemwatch.service.report.charts.thinning import extreme_samples
from stemwatch.service.report.charts.traces import (
    Chart,
    ChartFrame,
    chart_over_time,
    difference,
    frame_of,
    packed,
    panel,
    series,
)

SUSPECTED_STEM = "suspected stem"
BY_LINEAR_LOOP, BY_STICKING_VALVE = "PV by a linear loop", "PV by a sticking valve"
NOBODY_MEASURED = "Nobody has measured this stem: it is the one with which PV is predicted best."
# The loop of a whole record is a cloud with an outline; its stretch is drawn sample by sample.
LOOP_POINTS = 800


def chart_of(screening: Screening) -> Chart | None:
    """The plots of ``screening``; ``None`` where there is no recording or no sample to draw."""
    recording = screening.recording
    if recording is None or not len(recording) or not np.isfinite(recording.op.values).any():
        return None
    heldout = screening.traces.heldout_from
    frame = frame_of(recording, screening.traces.stiction, heldout)
    panels = [
        _travel(screening, recording, frame),
        _process(screening, recording, frame),
        _residuals(screening, recording, frame),
    ]
    chart = chart_over_time(recording, frame, heldout, panels)
    return {**chart, "loop": _loop(screening, recording)}


def _travel(screening: Screening, recording: Recording, frame: ChartFrame) -> Chart:
    traces = [series("op", "OP", recording.op.values, frame)]
    if recording.mv is not None:
        traces.append(series("mv", "MV", recording.mv.values, frame))
    if screening.traces.stiction is not None:
        label = "stick-slip model"
        traces.append(series("stiction", label, screening.traces.stiction, frame))
    suspicion = suspected_element(screening)
    if suspicion is not None:
        traces.append(series("stiction", SUSPECTED_STEM, suspicion.stem, frame))
    title = "Controller output and stem" if len(traces) > 1 else "Controller output"
    return panel("travel", title, "%", traces)


def suspected_element(screening: Screening) -> ElementTraces | None:
    """The traces of the suspicion from OP and PV, where the stem was not measured."""
    suspicion = screening.without_position
    has_stiction_fit = screening.traces.stiction is not None or suspicion is None
    return None if has_stiction_fit or suspicion is None else suspicion.traces


def _process(screening: Screening, recording: Recording, frame: ChartFrame) -> Chart | None:
    pv = _in_process_unit(recording, Role.PV)
    sp = _in_process_unit(recording, Role.SP)
    signals = [(role, signal) for role, signal in (("pv", pv), ("sp", sp)) if signal is not None]
    if pv is None:
        return None
    traces = [series(role, role.upper(), signal.values, frame) for role, signal in signals]
    suspicion, measured = suspected_element(screening), recording.get(Role.PV)
    if suspicion is not None and measured is not None:
        linear, sticking = predicted_pv(measured, suspicion)
        traces.append(series("naive", BY_LINEAR_LOOP, linear.values, frame))
        traces.append(series("extended", BY_STICKING_VALVE, sticking.values, frame))
    return panel("process", "Process", pv.unit, traces)


def predicted_pv(pv: Signal, element: ElementTraces) -> tuple[Signal, Signal]:
    """``pv`` in its engineering unit as the linear model and as the one with a sticking valve
    predict it."""
    linear = replace(pv, values=element.linear).in_process_unit()
    return linear, replace(pv, values=element.sticking).in_process_unit()


def _in_process_unit(recording: Recording, role: Role) -> Signal | None:
    signal = recording.get(role)
    return None if signal is None else signal.in_process_unit()


def _residuals(screening: Screening, recording: Recording, frame: ChartFrame) -> Chart | None:
    mv, traces = recording.mv, screening.traces
    if mv is None:
        return None
    models = (
        ("stiction", "MV − stick-slip model", traces.stiction),
        ("narx", "MV − NARX network", traces.narx),
    )
    residual_traces = [
        series(role, label, difference(mv, simulated), frame)
        for role, label, simulated in models
        if simulated is not None
    ]
    if not residual_traces:
        return None
    return panel("residual", "What the models leave unexplained", "%", residual_traces)


def _loop(screening: Screening, recording: Recording) -> Chart | None:
    """The recorded points and the simulated path against OP; PV stands in where MV is absent."""
    vertical, name = recording.mv, "MV"
    suspicion = suspected_element(screening)
    if vertical is None and suspicion is not None:
        return _suspected_loop(recording, suspicion)
    if vertical is None:
        vertical, name = _in_process_unit(recording, Role.PV), "PV"
    if vertical is None:
        return None
    op, simulated = recording.op.values, screening.traces.stiction
    axis_values = [op, vertical.values]
    if simulated is not None and name == "MV":
        axis_values.append(simulated)
    kept_samples = extreme_samples(axis_values, LOOP_POINTS)
    comparable = name == "MV" and vertical.unit == recording.op.unit
    shapes = loop_shapes(screening, op, vertical.values) if comparable else LoopShapes()
    labels = (
        ("recorded", name.lower(), "recorded"),
        ("stiction", "stiction", "stick-slip model"),
    )
    return {
        "title": f"{name} against OP",
        "x": "OP, %",
        "y": f"{name}, {printable(vertical.unit)}".rstrip(", "),
        "seconds": packed(recording.time_s[kept_samples]),
        "op": packed(op[kept_samples]),
        "traces": [
            {"role": role, "of": axis, "label": label, "values": packed(trace[kept_samples])}
            for (role, axis, label), trace in zip(labels, axis_values[1:], strict=False)
        ],
        "shapes": shapes.lines(),
        "says": printable(shapes.caption),
    }


def _suspected_loop(recording: Recording, element: ElementTraces) -> Chart:
    """The fitted element's stem against OP: nobody has measured it."""
    op = recording.op.values
    kept_samples = extreme_samples([op, element.stem], LOOP_POINTS)
    stem = packed(element.stem[kept_samples])
    trace = {"role": "stiction", "of": "stiction", "label": SUSPECTED_STEM, "values": stem}
    return {
        "title": "The suspected stem against OP",
        "x": "OP, %",
        "y": "stem, %",
        "seconds": packed(recording.time_s[kept_samples]),
        "op": packed(op[kept_samples]),
        "traces": [trace],
        "shapes": [],
        "says": NOBODY_MEASURED,
    }


NAIVE, EXTENDED = "S and J alone", "extended model"
FLOW = "flow, as a position"


def overlay_of(recording: Recording | None, runs: FreeRuns | None) -> Chart | None:
    """The overlay and both residuals; ``None`` where there is no position or nothing simulated.

    Raises ``ValueError`` where a run is not as long as the recording.
    """
    if recording is None or runs is None or recording.mv is None:
        return None
    if not np.isfinite(recording.op.values).any():
        return None
    recording = runs.followed(recording)
    assert recording.mv is not None
    frame = frame_of(recording, runs.naive, runs.heldout_from)
    models = [("naive", NAIVE, runs.naive)]
    if not np.array_equal(runs.naive, runs.extended, equal_nan=True):
        models.append(("extended", EXTENDED, runs.extended))
    mv = recording.mv
    name = "MV" if runs.position is None else FLOW
    left_axis = [
        series(role, f"{name} − {label}", difference(mv, run), frame) for role, label, run in models
    ]
    shapes = [
        series("op", "OP", recording.op.values, frame),
        series("mv", f"{name}, recorded", mv.values, frame),
        *[series(role, label, run, frame) for role, label, run in models],
    ]
    panels: list[Chart | None] = [
        panel("travel", "Recording and simulations", "%", shapes),
        panel("residual", "What each leaves unexplained", "%", left_axis),
    ]
    return chart_over_time(recording, frame, runs.heldout_from, panels)
