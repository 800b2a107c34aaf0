"""MV against OP over a window, with the loop of the fitted model."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import timedelta

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.service.report.charts.thinning import telling_samples
from stemwatch.service.report.charts.typical_stretch import typical_stretch_of
from stemwatch.service.web.fitted import fitted_run
from stemwatch.service.web.shapes import LoopAnswer, LoopTrace
from stemwatch.service.web.signals import Asked, json_numbers, read_recording
from stemwatch.service.web.site import Site

LONGEST_LOOP = timedelta(hours=12)
LOOP_POINTS = 1500
LABELS = (("recorded", "recorded"), ("stiction", "stick-slip model"))


def loop_of(site: Site, asked: Asked, indicators: Mapping[str, float]) -> LoopAnswer:
    """MV against OP with the fitted loop; of a long window a typical stretch, sample by sample.

    Without MV, PV stands in, and includes the process.
    """
    asked = asked.at_most(LONGEST_LOOP)
    recording, says = read_recording(site, asked)
    if recording is None:
        return _empty(asked, says)
    vertical = recording.mv or recording.get(Role.PV)
    if vertical is None:
        return _empty(asked, "Neither MV nor PV is recorded for this valve.")
    fitted = fitted_run(recording, indicators)
    part, why = _typical(recording, fitted)
    drawn = [
        trace[part] for trace in (recording.op.values, vertical.values, fitted) if trace is not None
    ]
    picked = telling_samples(drawn, LOOP_POINTS)
    start = (asked.start if recording.start is None else recording.start).timestamp()
    at_s = start + recording.time_s[part][picked]
    return LoopAnswer(
        valve=asked.valve,
        start_s=start + part.start * recording.interval_s,
        stop_s=start + part.stop * recording.interval_s,
        op=json_numbers(drawn[0][picked]),
        at_s=np.round(at_s, 3).tolist(),
        y="PV" if recording.mv is None else "MV",
        y_unit=vertical.unit,
        thinned=max(1, round((part.stop - part.start) / max(1, picked.size))),
        traces=[
            LoopTrace(role=role, label=label, values=json_numbers(values[picked]))
            for (role, label), values in zip(LABELS, drawn[1:], strict=False)
        ],
        says=why,
    )


def _typical(recording: Recording, fitted: Floats | None) -> tuple[slice, str]:
    """The samples that are drawn, and why these where they are not all."""
    whole = slice(0, len(recording))
    if len(recording) <= LOOP_POINTS // 3:
        return whole, ""
    stretch = typical_stretch_of(recording, fitted, None)
    if stretch is None:
        return whole, ""
    return slice(stretch.first, stretch.last), stretch.why


def _empty(asked: Asked, says: str) -> LoopAnswer:
    return LoopAnswer(
        valve=asked.valve,
        start_s=asked.start.timestamp(),
        stop_s=asked.stop.timestamp(),
        op=[],
        at_s=[],
        y="MV",
        y_unit="%",
        thinned=1,
        traces=[],
        says=says,
    )
