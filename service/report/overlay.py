"""The recording, S and J alone, and the extended model over one another, as a chart.

Its form is that of ``charts``, so that the same scripts draw and zoom it.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch.findings import FreeRuns
from stemwatch.models.recording import Recording
from stemwatch.service.report.panels import (
    Chart,
    chart_over_time,
    difference,
    frame_of,
    panel,
    series,
)

NAIVE, EXTENDED = "S and J alone", "extended model"


def overlay_of(recording: Recording | None, runs: FreeRuns | None) -> Chart | None:
    """The overlay and both residuals; ``None`` where there is no position or nothing simulated.

    Raises ``ValueError`` where a run is not as long as the recording.
    """
    if recording is None or runs is None or recording.mv is None:
        return None
    if not np.isfinite(recording.op.values).any():
        return None
    frame = frame_of(recording, runs.naive, runs.heldout_from)
    models = [("naive", NAIVE, runs.naive)]
    if not np.array_equal(runs.naive, runs.extended, equal_nan=True):
        models.append(("extended", EXTENDED, runs.extended))
    mv = recording.mv
    left = [
        series(role, f"MV − {label}", difference(mv, run), frame) for role, label, run in models
    ]
    drawn = [
        series("op", "OP", recording.op.values, frame),
        series("mv", "MV, recorded", mv.values, frame),
        *[series(role, label, run, frame) for role, label, run in models],
    ]
    panels: list[Chart | None] = [
        panel("travel", "Recording and simulations", "%", drawn),
        panel("residual", "What each leaves unexplained", "%", left),
    ]
    return chart_over_time(recording, frame, runs.heldout_from, panels)
