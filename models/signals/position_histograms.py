"""``position_histograms``: where the stem stood, travelled and reversed, as positioners count it.

Ten classes of 10 % of travel; readings below 0 % or above 100 % are in the outer ones. A stroke is
the travel between two reversals; a move within five standard deviations of the reading's noise (at
least 0.1 %) is none, as for the indicators ``travel_percent`` and ``mv_reversals``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import PERCENT, Floats, Recording
from stemwatch.models.signals.excitation import reversals
from stemwatch.models.signals.forensics import noise_sigma, quantum

CLASSES = 10
EDGES = np.linspace(0.0, 100.0, CLASSES + 1)
# Lengths of strokes that belong together, percent of travel: from ... to below ...
STROKE_EDGES = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
LEAST_MOVE_PERCENT = 0.1
SIGMAS = 5.0


@dataclass(frozen=True, kw_only=True)
class PositionHistograms:
    """By class of position (10,): ``time`` percent of the usable time, ``travel`` percent of travel
    that the stem made there, ``reversals`` how often it reversed there. ``strokes`` (8,) the number
    of each length, by ``STROKE_EDGES``. ``hours`` is the usable time.
    """

    time: tuple[float, ...]
    travel: tuple[float, ...]
    reversals: tuple[int, ...]
    strokes: tuple[int, ...]
    hours: float


def position_histograms(recording: Recording) -> PositionHistograms | None:
    """The histograms of a recording in percent of travel; ``None`` without a position that was
    read. Holes are bridged by straight lines, because the motion in them is not known.
    """
    if recording.mv is None or recording.mv.unit != PERCENT:
        return None
    mv = np.where(recording.mv.usable, recording.mv.values, np.nan)
    position = mv[np.isfinite(mv)]
    if position.size < 2:
        return None
    sigma = max(noise_sigma(mv), quantum(mv) / np.sqrt(12.0))
    threshold = max(SIGMAS * sigma, LEAST_MOVE_PERCENT)
    turns = reversals(position, threshold)
    points = np.concatenate((position[:1], position[turns], position[-1:]))
    moves = np.abs(np.diff(points))
    real = moves >= threshold
    low, high = np.minimum(points[:-1], points[1:])[real], np.maximum(points[:-1], points[1:])[real]
    lengths = np.searchsorted(STROKE_EDGES, moves[real], side="right") - 1
    return PositionHistograms(
        time=_rounded(100.0 * np.bincount(_class_of(position), minlength=CLASSES) / position.size),
        travel=_rounded(_way_in_classes(low, high)),
        reversals=_counted(_class_of(position[turns]), CLASSES),
        strokes=_counted(lengths, len(STROKE_EDGES)),
        hours=round(position.size * recording.interval_s * recording.unit_s / 3600.0, 4),
    )


def _class_of(position: Floats) -> NDArray[np.int64]:
    return np.clip(position // (100.0 / CLASSES), 0, CLASSES - 1).astype(np.int64)


def _way_in_classes(low: Floats, high: Floats) -> Floats:
    """(10,) how much of the strokes from ``low`` to ``high`` (m,) lies in each class."""
    edges = EDGES.copy()
    edges[0], edges[-1] = -np.inf, np.inf
    upper = np.minimum(high[:, None], edges[1:])
    lower = np.maximum(low[:, None], edges[:-1])
    return np.asarray(np.maximum(upper - lower, 0.0).sum(axis=0))


def _counted(classes: NDArray[np.int64], count: int) -> tuple[int, ...]:
    return tuple(int(number) for number in np.bincount(classes, minlength=count))


def _rounded(values: Floats) -> tuple[float, ...]:
    return tuple(round(float(value), 2) for value in values)
