"""Which samples of a tag are bad, and why; which tags bring nothing good although they are read."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import and_, func, select
from sqlalchemy.orm import Session

from stemwatch.models.recording import Quality
from stemwatch.service.store.samples.instants import instant_of, microseconds
from stemwatch.service.store.samples.tables import SampleReasonRow, SampleRow, TagRow

FRESH = timedelta(seconds=60)  # younger than this is a sample of now, not one from the spool


@dataclass(frozen=True, kw_only=True)
class BadSamples:
    """Samples of a tag that are not good: how many of how many, and why."""

    tag: str
    samples: int
    bad: int
    reasons: tuple[tuple[str, int], ...]


@dataclass(frozen=True, kw_only=True)
class LastGood:
    """When a tag was last good, ``None`` where it was not, and why it is bad now."""

    at: datetime | None
    reason: str | None


def read_bad(
    session: Session, number: int, tag: str, start: datetime, stop: datetime
) -> BadSamples:
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
    return BadSamples(
        tag=tag,
        samples=session.scalar(select(func.count()).where(there)) or 0,
        bad=session.scalar(select(func.count()).where(bad)) or 0,
        reasons=tuple((words, count) for words, count in session.execute(reasons)),
    )


def read_dead_tags(
    session: Session, source: str, limit: timedelta, now: datetime
) -> dict[str, int]:
    """The number of each tag of ``source`` whose samples since ``now - limit`` are all bad, one of
    the last minute among them: while old samples come from the spool nothing is known of it."""
    since = SampleRow.at_us > microseconds(now - limit)
    of_tag = select(SampleRow.at_us).where(SampleRow.tag_id == TagRow.id, since)
    of_tag = of_tag.order_by(SampleRow.at_us.desc()).limit(1).correlate(TagRow)
    newest = of_tag.scalar_subquery()
    good = of_tag.where(SampleRow.quality == 0).scalar_subquery()
    rows = select(TagRow.name, TagRow.id).where(
        TagRow.source == source, newest > microseconds(now - FRESH), good.is_(None)
    )
    return {name: number for name, number in session.execute(rows)}


def read_last_good(session: Session, number: int, since: datetime) -> LastGood:
    """The last good sample of a tag after ``since``, and what its newest bad one says."""
    mine = select(SampleRow.at_us).where(SampleRow.tag_id == number)
    newest_first = SampleRow.at_us.desc()
    good = mine.where(SampleRow.quality == 0, SampleRow.at_us > microseconds(since))
    last = session.scalar(good.order_by(newest_first).limit(1))
    words = session.scalar(
        select(SampleReasonRow.words)
        .join(SampleRow, SampleRow.reason_id == SampleReasonRow.id)
        .where(SampleRow.tag_id == number)
        .order_by(newest_first)
        .limit(1)
    )
    return LastGood(at=None if last is None else instant_of(last), reason=words)
