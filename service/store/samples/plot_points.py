"""Stored samples for plots: reduced by the database to the minimum and maximum of each interval."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from sqlalchemy import ColumnElement, and_, func, literal_column, select
from sqlalchemy.orm import Session

from stemwatch.models.recording import Floats, Quality
from stemwatch.service.store.samples.tables import SampleRow, microseconds

# A step this many times the usual one is a gap, over which no line is drawn.
HOLE_STEPS = 2.5


@dataclass(frozen=True, kw_only=True, eq=False)
class PlotPoints:
    """Points of one tag in order of time: ``at_s`` (m,) seconds since 1970, ``values`` (m,), NaN
    where the line breaks.

    ``bucket_s`` is the length in seconds that a pair of points (minimum and maximum) stands for;
    0 where every sample is a point.
    """

    at_s: Floats
    values: Floats
    bucket_s: float = 0.0


def read_plot_points(
    session: Session, number: int, start: datetime, stop: datetime, points: int
) -> PlotPoints:
    """The tag with this number from ``start`` to ``stop``, in about ``points`` points at most."""
    first, last = microseconds(start), microseconds(stop)
    in_window = and_(SampleRow.tag_id == number, SampleRow.at_us >= first, SampleRow.at_us < last)
    if (session.scalar(select(func.count()).where(in_window)) or 0) <= points:
        return _every_sample(session, in_window)
    width = max(1, -(-(last - first) // max(1, points // 2)))
    return _lowest_and_highest(session, in_window, first, width)


def _every_sample(session: Session, in_window: ColumnElement[bool]) -> PlotPoints:
    columns = select(SampleRow.at_us, SampleRow.value, SampleRow.quality).where(in_window)
    rows = session.execute(columns.order_by(SampleRow.at_us)).all()
    table = np.array([tuple(row) for row in rows], dtype=np.float64).reshape(-1, 3)
    values = np.where(table[:, 2] <= Quality.HELD, table[:, 1], np.nan)
    return with_holes(table[:, 0] / 1e6, values)


def _lowest_and_highest(
    session: Session, in_window: ColumnElement[bool], first: int, width: int
) -> PlotPoints:
    # Literals, because PostgreSQL does not see that two parameters in GROUP BY are the same.
    bucket: Any = (SampleRow.at_us - literal_column(str(first))) // literal_column(str(width))
    good = SampleRow.quality <= int(Quality.HELD)
    statement = select(
        bucket.label("bucket"), func.min(SampleRow.value), func.max(SampleRow.value)
    ).where(in_window, good, SampleRow.value.is_not(None))
    rows = session.execute(statement.group_by("bucket").order_by("bucket")).all()
    table = np.array([tuple(row) for row in rows], dtype=np.float64).reshape(-1, 3)
    bucket_start_s = (first + table[:, 0] * width) / 1e6
    step_s = width / 1e6
    at_s = np.stack([bucket_start_s + step_s / 4, bucket_start_s + 3 * step_s / 4], axis=1).ravel()
    points = with_holes(at_s, table[:, 1:].ravel(), usual_s=step_s / 2)
    return PlotPoints(at_s=points.at_s, values=points.values, bucket_s=step_s)


def with_holes(at_s: Floats, values: Floats, usual_s: float | None = None) -> PlotPoints:
    """The points with a NaN in the middle of each gap, so that no line is drawn over it.

    ``usual_s`` is the usual step in seconds, by default the median of the steps.
    """
    if at_s.size < 2:
        return PlotPoints(at_s=at_s, values=values)
    steps = np.diff(at_s)
    usual_step_s = float(np.median(steps)) if usual_s is None else usual_s
    holes = np.flatnonzero(steps > HOLE_STEPS * usual_step_s)
    middles = (at_s[holes] + at_s[holes + 1]) / 2
    return PlotPoints(
        at_s=np.insert(at_s, holes + 1, middles),
        values=np.insert(values, holes + 1, np.nan),
    )
