"""``ValvePlots``: the plots of one valve, made in the process that has its samples.

A day of samples is 6 MB, its plots are 0.1 MB. So only the plots are sent to other processes, with
a short excerpt of the samples where the valve may need work.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from stemwatch.models.oscillation_groups.plant_groups import ThinnedLoop, thinned_loop
from stemwatch.models.recording import Recording
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.report.charts.traces import Chart
from stemwatch.service.report.charts.typical_stretch import typical_stretch
from stemwatch.service.report.charts.valve_charts import chart_of, overlay_of
from stemwatch.service.report.charts.window_pictures import WindowPictures, window_pictures

EXCERPT_SAMPLES = 3600  # an hour at 1 s: 0.3 MB


@dataclass(frozen=True, kw_only=True)
class ValvePlots:
    """The plots of a valve; ``None`` for a plot without data.

    ``overlay`` is made where an effect was left out; otherwise the chart shows everything.
    ``pictures`` are also kept in the store. ``thinned_loop`` is used to compare all loops of the
    run.
    """

    chart: Chart | None
    overlay: Chart | None
    pictures: WindowPictures = field(default_factory=WindowPictures)
    thinned_loop: ThinnedLoop | None = None


def plots_of(screening: Screening) -> ValvePlots:
    """The plots of a screening that still has its samples."""
    mismatch = screening.mismatch
    left_out = mismatch is not None and bool(mismatch.effects)
    return ValvePlots(
        chart=chart_of(screening),
        overlay=overlay_of(screening.recording, mismatch.runs) if mismatch and left_out else None,
        pictures=window_pictures(screening),
        thinned_loop=_thinned_loop(screening),
    )


def _thinned_loop(screening: Screening) -> ThinnedLoop | None:
    if screening.recording is None:
        return None
    sticks = {Verdict.STICKY: True, Verdict.HEALTHY: False}.get(screening.verdict)
    told = screening.without_position
    return thinned_loop(screening.recording, sticks, None if told is None else told.likeness)


def plots_instead_of_samples(screening: Screening) -> tuple[Screening, ValvePlots]:
    """The result without its samples, or with an excerpt of them where the valve may need work, and
    its plots: all that a report needs of it."""
    evidence = plots_of(screening)
    recording = screening.recording
    if recording is None or not may_need_work(screening):
        return screening.without_samples(), evidence
    return screening.excerpt(*_typical_part(screening, recording)), evidence


def may_need_work(screening: Screening) -> bool:
    """Whether the valve may get a page with a picture in the maintenance report: all but a healthy
    valve on which nothing was named. Which effects stand, and which obstacles need work, is decided
    later."""
    mismatch = screening.mismatch
    return screening.verdict is not Verdict.HEALTHY or (
        mismatch is not None and bool(mismatch.effects)
    )


def _typical_part(screening: Screening, recording: Recording) -> tuple[int, int]:
    """The samples around the typical stretch, or the last ones that hold a command."""
    stretch = typical_stretch(screening)
    if stretch is None:
        finite = np.flatnonzero(np.isfinite(recording.op.values))
        middle = (int(finite[-1]) if finite.size else len(recording)) - EXCERPT_SAMPLES // 2
    else:
        middle = (stretch.first + stretch.last) // 2
    first = max(0, min(middle - EXCERPT_SAMPLES // 2, len(recording) - EXCERPT_SAMPLES))
    return first, min(first + EXCERPT_SAMPLES, len(recording))
