"""Bad samples of a tag and their reasons; tags that are polled but deliver no good sample."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import and_, func, select
from sqlalchemy.orm import Session

from stemwatch.connectors.modbus.sample_batch import CAME_TWICE
from stemwatch.models.recording import Quality
from stemwatch.service.store.samples.tables import (
    SampleReasonRow,
    SampleRow,
    TagRow,
    instant_of,
    microseconds,
)

FRESH = timedelta(seconds=60)  # a tag with a younger sample is being polled now


@dataclass(frozen=True, kw_only=True)
class BadSamples:
    """How many of a tag's samples are bad, with the number for each reason."""

    tag: str
    samples: int
    bad: int
    reasons: tuple[tuple[str, int], ...]


@dataclass(frozen=True, kw_only=True)
class LastGood:
    """The instant of a tag's last good sample, ``None`` where there is none, and why its newest
    sample is bad."""

    at: datetime | None
    reason: str | None


def read_bad(
    session: Session, number: int, tag: str, start: datetime, stop: datetime
) -> BadSamples:
    """How many samples of a tag are not good, and their reasons."""
    in_window = and_(
        SampleRow.tag_id == number,
        SampleRow.at_us >= microseconds(start),
        SampleRow.at_us < microseconds(stop),
    )
    bad = and_(in_window, SampleRow.quality != int(Quality.GOOD))
    reasons = (
        select(SampleReasonRow.words, func.count())
        .join(SampleRow, SampleRow.reason_id == SampleReasonRow.id)
        .where(bad)
        .group_by(SampleReasonRow.words)
        .order_by(func.count().desc())
    )
    return BadSamples(
        tag=tag,
        samples=session.scalar(select(func.count()).where(in_window)) or 0,
        bad=session.scalar(select(func.count()).where(bad)) or 0,
        reasons=tuple((words, count) for words, count in session.execute(reasons)),
    )


def read_dead_tags(
    session: Session, source: str, limit: timedelta, now: datetime
) -> dict[str, int]:
    """The number of each tag of ``source`` whose samples since ``now - limit`` are all bad. Tags
    without a sample of the last minute are left out: theirs may still be waiting in the spool; so
    are those that are bad because the clock was set back, which says nothing of the tag."""
    since = SampleRow.at_us > microseconds(now - limit)
    came_twice = select(SampleReasonRow.id).where(SampleReasonRow.words == CAME_TWICE)
    not_repeated = func.coalesce(SampleRow.reason_id, 0) != func.coalesce(
        came_twice.scalar_subquery(), -1
    )
    last_good_of_tag = select(SampleRow.at_us).where(
        SampleRow.tag_id == TagRow.id, since, not_repeated
    )
    last_good_of_tag = last_good_of_tag.order_by(SampleRow.at_us.desc()).limit(1).correlate(TagRow)
    newest = last_good_of_tag.scalar_subquery()
    good = last_good_of_tag.where(SampleRow.quality == 0).scalar_subquery()
    rows = select(TagRow.name, TagRow.id).where(
        TagRow.source == source, newest > microseconds(now - FRESH), good.is_(None)
    )
    return {name: number for name, number in session.execute(rows)}


def read_last_good(session: Session, number: int, since: datetime) -> LastGood:
    """The last good sample of a tag after ``since``, and the reason of its newest bad one."""
    times_of_tag = select(SampleRow.at_us).where(SampleRow.tag_id == number)
    newest_first = SampleRow.at_us.desc()
    good = times_of_tag.where(SampleRow.quality == 0, SampleRow.at_us > microseconds(since))
    last = session.scalar(good.order_by(newest_first).limit(1))
    words = session.scalar(
        select(SampleReasonRow.words)
        .join(SampleRow, SampleRow.reason_id == SampleReasonRow.id)
        .where(SampleRow.tag_id == number)
        .order_by(newest_first)
        .limit(1)
    )
    return LastGood(at=None if last is None else instant_of(last), reason=words)
