"""The pictures of a suspicion from OP and PV alone: what a control engineer looks at to believe it
or not."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.without_position.picture import ElementTraces
from stemwatch.service.presenter.wording import figure, printable
from stemwatch.service.report.charts.small_plot import Picture, PlottedLine, SmallPlot
from stemwatch.service.report.charts.thinning import extreme_samples
from stemwatch.service.report.charts.typical_stretch import typical_stretch_of
from stemwatch.service.report.charts.valve_charts import (
    BY_LINEAR_LOOP,
    BY_STICKING_VALVE,
    NOBODY_MEASURED,
    SUSPECTED_STEM,
    predicted_pv,
)

MOST_POINTS = 400  # of all lines of a picture
WIDE = 740
_UNITS_OF_TIME = ((3 * 3600.0, 3600.0, "h"), (600.0, 60.0, "min"), (0.0, 1.0, "s"))


@dataclass(frozen=True)
class ShownSuspicion:
    """The pictures of a suspicion from OP and PV; ``until`` is the end of the earlier window that
    they are of, ``None`` for the latest."""

    pictures: tuple[Picture, ...]
    until: datetime | None = None


def suspicion_pictures(recording: Recording, element: ElementTraces) -> tuple[Picture, ...]:
    """The suspected stem over time and against OP, and PV by both models, over a typical stretch of
    ``recording``, whose samples ``element`` belongs to. Of a recording with a hole only one piece
    was looked at: the stretch is of that."""
    misses = _misses(recording, element)
    seen = np.flatnonzero(np.isfinite(element.stem))
    if seen.size:
        recording = recording.part(int(seen[0]), int(seen[-1]) + 1)
        element = element.part(int(seen[0]), int(seen[-1]) + 1)
    stretch = typical_stretch_of(recording, None, None)
    if stretch is not None:
        recording = recording.part(stretch.first, stretch.last)
        element = element.part(stretch.first, stretch.last)
    pv = recording.get(Role.PV)
    return (
        _stem_over_time(recording, element),
        *(() if pv is None else (_both_models(recording, pv, element, misses),)),
        _stem_against_op(recording, element),
    )


def _stem_over_time(recording: Recording, element: ElementTraces) -> Picture:
    op = recording.op.values
    kept, time, time_label = _over_time(recording, [op, element.stem])
    plot = SmallPlot(
        x_label=time_label,
        y_label="percent of OP",
        description="OP and the stem that is suspected to stick, over time.",
        lines=[
            PlottedLine("op", "OP", time, op[kept]),
            PlottedLine("mv", SUSPECTED_STEM, time, element.stem[kept]),
        ],
        width=WIDE,
    )
    return Picture(title="OP and the suspected stem", plot=plot, caption=NOBODY_MEASURED)


def _stem_against_op(recording: Recording, element: ElementTraces) -> Picture:
    op = recording.op.values
    kept = extreme_samples([op, element.stem], MOST_POINTS)
    plot = SmallPlot(
        x_label="OP, %",
        y_label="stem, %",
        description="The stem that is suspected to stick against OP.",
        lines=[PlottedLine("mv", SUSPECTED_STEM, op[kept], element.stem[kept])],
        legend=False,
    )
    return Picture(
        title="The suspected stem against OP",
        plot=plot,
        caption="A stem that does not stick lies on one line.",
    )


def _misses(recording: Recording, element: ElementTraces) -> str:
    """By how much each model misses PV in the whole record, a sentence; empty without PV."""
    pv = recording.get(Role.PV)
    if pv is None:
        return ""
    measured = pv.in_process_unit()
    by_models = [predicted.values for predicted in predicted_pv(pv, element)]
    known = np.isfinite(measured.values + by_models[0] + by_models[1])
    if not known.any():
        return ""
    # A prediction is one value for a block of samples, and it is of their mean.
    block = np.cumsum(np.diff(by_models[0][known], prepend=np.nan) != 0.0) - 1
    samples = np.bincount(block)
    linear, sticking = (
        figure(float(np.sqrt(np.mean((np.bincount(block, miss) / samples) ** 2))))
        for miss in ((predicted - measured.values)[known] for predicted in by_models)
    )
    unit = f" {printable(measured.unit)}" if measured.unit else ""
    return (
        f" Over the whole record the linear loop misses PV by {linear}{unit} rms, the sticking "
        f"valve by {sticking}{unit}."
    )


def _both_models(recording: Recording, pv: Signal, element: ElementTraces, misses: str) -> Picture:
    linear, sticking = predicted_pv(pv, element)
    measured = pv.in_process_unit()
    kept, time, time_label = _over_time(
        recording, [measured.values, linear.values, sticking.values]
    )
    plot = SmallPlot(
        x_label=time_label,
        y_label=f"PV, {printable(measured.unit)}".rstrip(", "),
        description="PV as recorded, as a linear loop and as a sticking valve predict it.",
        lines=[
            PlottedLine("pv", "PV, recorded", time, measured.values[kept], dots=True),
            PlottedLine("naive", BY_LINEAR_LOOP, time, linear.values[kept], dashed=True),
            PlottedLine("extended", BY_STICKING_VALVE, time, sticking.values[kept]),
        ],
        width=WIDE,
    )
    return Picture(
        title="PV as both models predict it",
        plot=plot,
        caption=f"Each predicts one step ahead, on stretches that it was not fitted to.{misses}",
    )


def _over_time(recording: Recording, lines: list[Floats]) -> tuple[NDArray[np.intp], Floats, str]:
    """The samples to draw of ``lines``, their times from the first on, and the axis they are on."""
    kept = extreme_samples(lines, MOST_POINTS)
    seconds = recording.time_s[kept] * recording.unit_s
    unit_s, unit = next((s, name) for least, s, name in _UNITS_OF_TIME if seconds[-1] >= least)
    return kept, np.asarray(seconds / unit_s, dtype=np.float64), f"time, {unit}"
