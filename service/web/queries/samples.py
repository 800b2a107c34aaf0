"""Stored samples as a plot draws them: thinned by the database, lowest and highest kept."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from sqlalchemy import ColumnElement, and_, func, literal_column, select
from sqlalchemy.orm import Session

from stemwatch.models.recording import Floats, Quality
from stemwatch.service.store.database.columns import clean_text
from stemwatch.service.store.samples.samples import microseconds
from stemwatch.service.store.samples.tables import SampleReasonRow, SampleRow, TagRow

# A step this many times the usual one is a hole, and a line over it would be invented.
HOLE_STEPS = 2.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """Points of one tag in order of time: (m,) epoch seconds, and values, NaN where a line breaks.

    ``bucket_s`` is what a pair of points stands for, its lowest and highest value; 0 where every
    sample is a point of its own.
    """

    at_s: Floats
    values: Floats
    bucket_s: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Bad:
    """Samples of a tag that are not good: how many of how many, and why."""

    tag: str
    samples: int
    bad: int
    reasons: tuple[tuple[str, int], ...]


def tag_number(session: Session, source: str, tag: str) -> int | None:
    """The number under which samples know a tag; ``None`` where it never had one."""
    wanted = (TagRow.source == source, TagRow.name == clean_text(tag))
    return session.scalar(select(TagRow.id).where(*wanted))


def read_bounds(session: Session, number: int) -> tuple[float, float] | None:
    """Epoch seconds of a tag's first and last sample."""
    one = SampleRow.tag_id == number
    first = session.scalar(select(func.min(SampleRow.at_us)).where(one))
    last = session.scalar(select(func.max(SampleRow.at_us)).where(one))
    return None if first is None or last is None else (first / 1e6, last / 1e6)


def read_drawn(
    session: Session, number: int, start: datetime, stop: datetime, points: int
) -> Drawn:
    """A tag from ``start`` to ``stop`` in about ``points`` points at most."""
    first, last = microseconds(start), microseconds(stop)
    there = and_(SampleRow.tag_id == number, SampleRow.at_us >= first, SampleRow.at_us < last)
    if (session.scalar(select(func.count()).where(there)) or 0) <= points:
        return _every_one(session, there)
    width = max(1, -(-(last - first) // max(1, points // 2)))
    return _lowest_and_highest(session, there, first, width)


def _every_one(session: Session, there: ColumnElement[bool]) -> Drawn:
    columns = select(SampleRow.at_us, SampleRow.value, SampleRow.quality).where(there)
    rows = session.execute(columns.order_by(SampleRow.at_us)).all()
    table = np.array([tuple(row) for row in rows], dtype=np.float64).reshape(-1, 3)
    values = np.where(table[:, 2] <= Quality.HELD, table[:, 1], np.nan)
    return with_holes(table[:, 0] / 1e6, values)


def _lowest_and_highest(
    session: Session, there: ColumnElement[bool], first: int, width: int
) -> Drawn:
    # Written into the statement: PostgreSQL does not see that two parameters are the same number.
    bucket: Any = (SampleRow.at_us - literal_column(str(first))) // literal_column(str(width))
    good = SampleRow.quality <= int(Quality.HELD)
    statement = select(
        bucket.label("bucket"), func.min(SampleRow.value), func.max(SampleRow.value)
    ).where(there, good, SampleRow.value.is_not(None))
    rows = session.execute(statement.group_by("bucket").order_by("bucket")).all()
    table = np.array([tuple(row) for row in rows], dtype=np.float64).reshape(-1, 3)
    whole = (first + table[:, 0] * width) / 1e6
    step_s = width / 1e6
    at = np.stack([whole + step_s / 4, whole + 3 * step_s / 4], axis=1).ravel()
    drawn = with_holes(at, table[:, 1:].ravel(), usual_s=step_s / 2)
    return Drawn(at_s=drawn.at_s, values=drawn.values, bucket_s=step_s)


def with_holes(at_s: Floats, values: Floats, usual_s: float | None = None) -> Drawn:
    """The points with a NaN in the middle of each hole, so that no line is drawn over it.

    ``usual_s`` is the usual step; the median of the steps where it is not given.
    """
    if at_s.size < 2:
        return Drawn(at_s=at_s, values=values)
    steps = np.diff(at_s)
    usual = float(np.median(steps)) if usual_s is None else usual_s
    holes = np.flatnonzero(steps > HOLE_STEPS * usual)
    middles = (at_s[holes] + at_s[holes + 1]) / 2
    return Drawn(
        at_s=np.insert(at_s, holes + 1, middles),
        values=np.insert(values, holes + 1, np.nan),
    )


def read_bad(session: Session, number: int, tag: str, start: datetime, stop: datetime) -> Bad:
    """How many samples of a tag are not good, and the reasons that were noted."""
    there = and_(
        SampleRow.tag_id == number,
        SampleRow.at_us >= microseconds(start),
        SampleRow.at_us < microseconds(stop),
    )
    bad = and_(there, SampleRow.quality != int(Quality.GOOD))
    reasons = (
        select(SampleReasonRow.words, func.count())
        .join(SampleRow, SampleRow.reason_id == SampleReasonRow.id)
        .where(bad)
        .group_by(SampleReasonRow.words)
        .order_by(func.count().desc())
    )
    return Bad(
        tag=tag,
        samples=session.scalar(select(func.count()).where(there)) or 0,
        bad=session.scalar(select(func.count()).where(bad)) or 0,
        reasons=tuple((words, count) for words, count in session.execute(reasons)),
    )
