"""Tables of what comes in while the service runs: samples, and how each source is doing."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import BigInteger, ForeignKey, SmallInteger, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from stemwatch.service.store.database.columns import TableBase


class TagRow(TableBase):
    """A tag of a source; samples know it by a number."""

    __tablename__ = "tags"
    __table_args__ = (UniqueConstraint("source", "name"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    source: Mapped[str]
    name: Mapped[str]
    unit: Mapped[str]


class SampleRow(TableBase):
    """One sample: at most one of each tag and instant, the first that came.

    ``at_us`` microseconds since 1970 UTC, ``value`` in the tag's unit, ``quality`` of
    ``models.recording.Quality``, ``reason_id`` why the sample is not good.
    """

    __tablename__ = "samples"
    # The key is the table: half the size, and a window of a tag is one stretch of it.
    __table_args__ = ({"sqlite_with_rowid": False},)

    tag_id: Mapped[int] = mapped_column(
        ForeignKey("tags.id", ondelete="CASCADE"), primary_key=True, autoincrement=False
    )
    at_us: Mapped[int] = mapped_column(BigInteger, primary_key=True, autoincrement=False)
    value: Mapped[float | None]
    quality: Mapped[int] = mapped_column(SmallInteger)
    reason_id: Mapped[int | None] = mapped_column(ForeignKey("sample_reasons.id"))


class SampleReasonRow(TableBase):
    """A sentence that says why samples are bad, kept once."""

    __tablename__ = "sample_reasons"
    __table_args__ = (UniqueConstraint("words"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    words: Mapped[str]


class SourceStateRow(TableBase):
    """How a source is doing, as its collector or watcher said last."""

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
    """A file from a watched folder, by the digest of its bytes."""

    __tablename__ = "taken_files"

    digest: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    source: Mapped[str]
    taken: Mapped[datetime]
    accepted: Mapped[bool]
    samples: Mapped[int] = mapped_column(BigInteger)
    note: Mapped[str]
