"""The histograms of a stem's position as the page shows them: rows of bars with their numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from stemwatch.models.signals.position_histograms import EDGES, STROKE_EDGES, PositionHistograms
from stemwatch.service.presenter.wording import figure


@dataclass(frozen=True, kw_only=True)
class HistogramBar:
    """A number and the length of its bar, percent of the longest in its column."""

    text: str
    length: float


@dataclass(frozen=True, kw_only=True)
class HistogramRow:
    """A class and its bars, one for each column."""

    label: str
    bars: tuple[HistogramBar, ...]


@dataclass(frozen=True, kw_only=True)
class HistogramTable:
    """Rows by class of position (time, travel, reversals) and by length of strokes."""

    by_position: tuple[HistogramRow, ...]
    by_length: tuple[HistogramRow, ...]
    sentence: str


def histogram_table(histograms: PositionHistograms | None) -> HistogramTable | None:
    """What the page shows of ``histograms``; ``None`` where there are none."""
    if histograms is None:
        return None
    classes = [f"{low:.0f} to {high:.0f}" for low, high in pairwise(EDGES)]
    lengths = [f"{low:g} to {high:g}" for low, high in pairwise(STROKE_EDGES)]
    lengths = [f"below {STROKE_EDGES[1]:g}", *lengths[1:], f"{STROKE_EDGES[-1]:g} and more"]
    columns = [
        _bars(values) for values in (histograms.time, histograms.travel, histograms.reversals)
    ]
    return HistogramTable(
        by_position=_rows(classes, columns),
        by_length=_rows(lengths, [_bars(histograms.strokes)]),
        sentence=(
            f"Of {figure(histograms.hours, 3)} h with a good position reading: "
            f"{sum(histograms.reversals)} reversals, "
            f"{figure(sum(histograms.travel) / 100.0, 3)} full strokes of travel. Moves within "
            "five standard deviations of the noise are not counted; what reads below 0 % or "
            "above 100 % is in the outer classes."
        ),
    )


def _rows(
    labels: Sequence[str], columns: Sequence[Sequence[HistogramBar]]
) -> tuple[HistogramRow, ...]:
    return tuple(
        HistogramRow(label=label, bars=bars)
        for label, bars in zip(labels, zip(*columns, strict=True), strict=True)
    )


def _bars(values: Sequence[float]) -> list[HistogramBar]:
    longest = max(values, default=0) or 1
    return [
        HistogramBar(
            text=str(value) if isinstance(value, int) else figure(value, 3),
            length=round(100.0 * value / longest, 1),
        )
        for value in values
    ]
