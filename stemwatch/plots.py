"""Figures of a result with matplotlib, which comes with the extra ``notebook``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.maintenance.evidence_picture import part_drawn, simulated_run
from stemwatch.service.report.charts.loop_shapes import BAND, CURVE, LoopShapes, loop_shapes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NO_MATPLOTLIB = (
    "a plot needs matplotlib, which is not installed; it comes with the extra notebook: "
    "pip install 'stemwatch[notebook]'"
)
_SIZE = (11.0, 3.6)
_OP, _MV, _MODEL, _NAIVE, _CURVE = "#5b6675", "#17202c", "#2a6fb0", "#c2500a", "#0e7f78"


def screening_figure(screening: Screening, verdict: Verdict) -> Figure:
    """OP, MV and the model over time; beside it MV against OP with the stick band of S and J.

    ``verdict`` is that on the valve, which the title names.

    Raises ``ModuleNotFoundError`` without matplotlib, ``ValueError`` without samples.
    """
    figure = _figure()
    recording = _drawable(screening.recording, screening.valve)
    simulated = simulated_run(screening, recording)
    part, reason = part_drawn(recording, simulated)
    mv = recording.mv
    ratios = [1.0] if mv is None else [2.4, 1.0]
    panels = figure.add_gridspec(1, len(ratios), width_ratios=ratios)
    time = figure.add_subplot(panels[0, 0])
    _over_time(time, recording, part, simulated)
    time.set_title(
        f"{screening.valve}: {verdict.value} ({reason[0].lower()}{reason[1:]})", loc="left"
    )
    if mv is not None:
        _against_op(figure.add_subplot(panels[0, 1]), screening, recording, part)
    return figure


def mismatch_figure(recording: Recording | None, mismatch: Mismatch) -> Figure:
    """MV beside the free runs of S and J alone and with what was left out, over time.

    Raises ``ModuleNotFoundError`` without matplotlib, ``ValueError`` without samples.
    """
    figure = _figure()
    drawable = _drawable(recording, "this valve")
    naive = mismatch.runs.naive if mismatch.runs is not None else None
    extended = mismatch.runs.extended if mismatch.runs is not None and mismatch.effects else None
    part, _ = part_drawn(drawable, naive)
    axes = figure.add_subplot()
    _over_time(axes, drawable, part, extended)
    if naive is not None:
        time_s = drawable.time_s[part] - drawable.time_s[part.start]
        axes.plot(time_s, naive[part], color=_NAIVE, linewidth=1.0, label="S and J alone")
        axes.legend(loc="best", fontsize="small")
    axes.set_title(f"{drawable.valve}: {mismatch.finding.value.replace('_', ' ')}", loc="left")
    return figure


def _figure() -> Figure:
    try:
        from matplotlib.figure import Figure
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(NO_MATPLOTLIB, name="matplotlib") from error
    return Figure(figsize=_SIZE, layout="constrained")


def _drawable(recording: Recording | None, valve: str) -> Recording:
    if recording is None or np.isfinite(recording.op.values).sum() < 2:
        raise ValueError(f"{valve}: no samples of the controller output are there to be drawn")
    return recording


def _over_time(axes: Any, recording: Recording, part: slice, simulated: Floats | None) -> None:
    time_s = recording.time_s[part] - recording.time_s[part.start]
    axes.plot(
        time_s, recording.op.values[part], color=_OP, linewidth=0.9, linestyle="--", label="OP"
    )
    if recording.mv is not None:
        axes.plot(time_s, recording.mv.values[part], color=_MV, linewidth=1.4, label="MV")
    if simulated is not None:
        axes.plot(time_s, simulated[part], color=_MODEL, linewidth=1.0, label="model")
    axes.set_xlabel("time, s")
    axes.set_ylabel(f"{recording.op.unit or 'unit not known'}")
    axes.legend(loc="best", fontsize="small")


def _against_op(axes: Any, screening: Screening, recording: Recording, part: slice) -> None:
    assert recording.mv is not None
    op, mv = recording.op.values[part], recording.mv.values[part]
    comparable = recording.mv.unit == recording.op.unit
    shapes = loop_shapes(screening, op, mv) if comparable else LoopShapes()
    if shapes.band is not None:
        axes.fill(shapes.band[:, 0], shapes.band[:, 1], color=_MODEL, alpha=0.15, label=BAND)
    if shapes.curve is not None:
        axes.plot(*shapes.curve.T, color=_CURVE, linewidth=1.2, linestyle="--", label=CURVE)
    if shapes.band is not None or shapes.curve is not None:
        axes.legend(loc="best", fontsize="small")
    axes.plot(op, mv, color=_MV, linewidth=0.8)
    axes.set_xlabel("OP, %")
    axes.set_ylabel("MV, %")


__all__ = ["mismatch_figure", "screening_figure"]
