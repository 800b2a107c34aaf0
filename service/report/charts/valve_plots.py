"""``ValvePlots``: what the page draws of one valve, worked out where its samples are.

A day of samples is 6 MB and what is drawn of it 0.1 MB. Plots are therefore made by the process
that read the samples, and only they travel, with a short excerpt where the valve may need work.
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
    """The plots of a valve; ``None`` for one that has nothing to draw.

    ``overlay`` is drawn where something was left out; else the chart says it all. ``pictures`` are
    what the store keeps as well. ``thinned_loop`` is what all loops of the run are compared by.
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
    return thinned_loop(screening.recording, sticks, None if told is None else told.score)


def plots_instead_of_samples(screening: Screening) -> tuple[Screening, ValvePlots]:
    """The result without its samples, or with an excerpt of them where the valve may need work, and
    its plots: all that a report needs of it."""
    evidence = plots_of(screening)
    recording = screening.recording
    if recording is None or not may_need_work(screening):
        return screening.without_samples(), evidence
    return screening.excerpt(*_typical_part(screening, recording)), evidence


def may_need_work(screening: Screening) -> bool:
    """Whether maintenance may get a page of it, with a picture: all but a healthy valve on which
    nothing was named. Which effects stand, and which obstacle is work, is decided later."""
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
