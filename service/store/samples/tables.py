"""Tables of tags, samples and the states of sources; instants as samples store them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import BigInteger, ForeignKey, SmallInteger, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from stemwatch.service.store.database.columns import TableBase

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MICROSECOND = timedelta(microseconds=1)


def microseconds(instant: datetime) -> int:
    """Microseconds since 1970 UTC."""
    return (instant - EPOCH) // _MICROSECOND


def instant_of(at_us: int) -> datetime:
    """The instant ``at_us`` microseconds after 1970, in UTC."""
    return EPOCH + at_us * _MICROSECOND


class TagRow(TableBase):
    """A tag of a source; samples refer to it by its number."""

    __tablename__ = "tags"
    __table_args__ = (UniqueConstraint("source", "name"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    source: Mapped[str]
    name: Mapped[str]
    unit: Mapped[str]


class SampleRow(TableBase):
    """One sample; of several with the same tag and instant the first one is kept.

    ``at_us`` is microseconds since 1970 UTC, ``value`` in the tag's unit, ``quality`` a
    ``models.recording.Quality``, ``reason_id`` why the sample is not good.
    """

    __tablename__ = "samples"
    # Rows lie in the order of the key: half the size, and a tag's window is contiguous.
    __table_args__ = ({"sqlite_with_rowid": False},)

    tag_id: Mapped[int] = mapped_column(
        ForeignKey("tags.id", ondelete="CASCADE"), primary_key=True, autoincrement=False
    )
    at_us: Mapped[int] = mapped_column(BigInteger, primary_key=True, autoincrement=False)
    value: Mapped[float | None]
    quality: Mapped[int] = mapped_column(SmallInteger)
    reason_id: Mapped[int | None] = mapped_column(ForeignKey("sample_reasons.id"))


class SampleReasonRow(TableBase):
    """A reason why samples are bad, stored once."""

    __tablename__ = "sample_reasons"
    __table_args__ = (UniqueConstraint("words"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    words: Mapped[str]


class SourceStateRow(TableBase):
    """The state of a source, as last reported by its collector or folder watcher."""

    __tablename__ = "source_states"

    source: Mapped[str] = mapped_column(primary_key=True)
    kind: Mapped[str]  # "modbus" or "folder"
    address: Mapped[str]  # without secrets
    updated: Mapped[datetime]
    last_good: Mapped[datetime | None]
    connected: Mapped[bool]
    fault: Mapped[str]
    figures: Mapped[dict[str, Any]]  # counts, and lateness in seconds


class TakenFileRow(TableBase):
    """A file from a watched folder, identified by the SHA-256 of its bytes."""

    __tablename__ = "taken_files"

    digest: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    source: Mapped[str]
    taken: Mapped[datetime]
    accepted: Mapped[bool]
    samples: Mapped[int] = mapped_column(BigInteger)
    note: Mapped[str]
    too_old: Mapped[int] = mapped_column(BigInteger, server_default="0")  # samples of it
