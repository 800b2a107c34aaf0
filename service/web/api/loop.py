"""MV against OP over a window, with the loop of the fitted model."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.models.screening_result import Screening
from stemwatch.models.stickslip.stroke_curve import StrokeCurve, in_travel
from stemwatch.service.report.charts.loop_shapes import LoopShapes, loop_shapes
from stemwatch.service.report.charts.thinning import extreme_samples
from stemwatch.service.report.charts.typical_stretch import typical_stretch_of
from stemwatch.service.web.api.schemas import LoopAnswer, LoopShape, LoopTrace
from stemwatch.service.web.api.signals import SignalWindow, json_numbers, read_recording
from stemwatch.service.web.site import Site

_NEUTRAL = {
    "dead_time_s": 0.0,
    "lag_rising_s": 0.0,
    "lag_falling_s": 0.0,
    "speed_rising_percent_per_s": np.inf,
    "speed_falling_percent_per_s": np.inf,
    "position_zero_percent": 0.0,
}


def fitted_run(
    recording: Recording, indicators: Mapping[str, float], curve: StrokeCurve | None = None
) -> Floats | None:
    """(n,) free run of MV in percent, NaN where OP or MV is not known; ``None`` where S, J or MV is
    missing, or MV is not in percent.

    The element is that of ``models.stickslip.kernel`` in its canonical form, with the stored S, J,
    dead time, lags, speed limits and zero; it starts from the measurement and after each hole.
    Where there is a ``curve`` from OP to stroke the element gets percent of travel, as when it was
    fitted.
    """
    mv = recording.mv
    S, J = indicators.get("S_percent"), indicators.get("J_percent")
    if mv is None or S is None or J is None or mv.unit != recording.op.unit:
        return None
    usable = recording.usable
    if usable.sum() < 2:
        return None
    from stemwatch.models.stickslip.problem import make_problem  # compiled: loaded when asked for

    fitted_numbers = {name: indicators.get(name, default) for name, default in _NEUTRAL.items()}
    scale = 1.0 if curve is None else abs(curve.slope)
    q = np.array([scale * S, scale * J, *fitted_numbers.values(), 1.0, 0.0])
    return np.where(usable, make_problem(in_travel(recording, curve)).simulate(q), np.nan)


LONGEST_LOOP = timedelta(hours=12)
LOOP_POINTS = 1500
LABELS = (("recorded", "recorded"), ("stiction", "stick-slip model"))


def loop_of(
    site: Site,
    window: SignalWindow,
    indicators: Mapping[str, float],
    screening: Screening | None = None,
) -> LoopAnswer:
    """MV against OP with the fitted loop; of a long window a typical stretch, sample by sample.

    Behind it the curve and the stick band of ``screening``, the valve's latest.

    Without MV, PV stands in, and includes the process.
    """
    window = window.at_most(LONGEST_LOOP)
    recording, sentence = read_recording(site, window)
    if recording is None:
        return _empty(window, sentence)
    pv = recording.get(Role.PV)
    vertical = recording.mv or (None if pv is None else pv.in_process_unit())
    if vertical is None:
        return _empty(window, "Neither MV nor PV is recorded for this valve.")
    curve = None if screening is None else screening.stroke_curve
    fitted = fitted_run(recording, indicators, curve)
    shapes = LoopShapes()
    if screening is not None and recording.mv is not None and vertical.unit == recording.op.unit:
        shapes = loop_shapes(screening, recording.op.values, vertical.values)
    part, reason = _typical(recording, fitted)
    axis_values = [
        trace[part] for trace in (recording.op.values, vertical.values, fitted) if trace is not None
    ]
    kept_samples = extreme_samples(axis_values, LOOP_POINTS)
    start = (window.start if recording.start is None else recording.start).timestamp()
    at_s = start + recording.time_s[part][kept_samples]
    return LoopAnswer(
        valve=window.valve,
        start_s=start + part.start * recording.interval_s,
        stop_s=start + part.stop * recording.interval_s,
        op=json_numbers(axis_values[0][kept_samples]),
        at_s=np.round(at_s, 3).tolist(),
        y="PV" if recording.mv is None else "MV",
        y_unit=vertical.unit,
        thinned=max(1, round((part.stop - part.start) / max(1, kept_samples.size))),
        traces=[
            LoopTrace(role=role, label=label, values=json_numbers(values[kept_samples]))
            for (role, label), values in zip(LABELS, axis_values[1:], strict=False)
        ],
        shapes=[LoopShape(**shape) for shape in shapes.lines()],
        curve_says=shapes.caption,
        says=reason,
    )


def _typical(recording: Recording, fitted: Floats | None) -> tuple[slice, str]:
    """The samples that are drawn, and why these where they are not all."""
    whole_record = slice(0, len(recording))
    if len(recording) <= LOOP_POINTS // 3:
        return whole_record, ""
    stretch = typical_stretch_of(recording, fitted, None)
    if stretch is None:
        return whole_record, ""
    return slice(stretch.first, stretch.last), stretch.why


def _empty(window: SignalWindow, sentence: str) -> LoopAnswer:
    return LoopAnswer(
        valve=window.valve,
        start_s=window.start.timestamp(),
        stop_s=window.stop.timestamp(),
        op=[],
        at_s=[],
        y="MV",
        y_unit="%",
        thinned=1,
        traces=[],
        says=sentence,
    )
