"""``SampleStore``: the samples of devices and watched folders, each stored once."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TypeVarTuple

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, Select, delete, func, select, text
from sqlalchemy.orm import Session

from stemwatch.connectors.modbus.sample_batch import CAME_TWICE, SampleBatch
from stemwatch.models.recording import Floats, QualityCodes
from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.samples import partitions
from stemwatch.service.store.samples.bulk_insert import SampleColumns, insert_samples
from stemwatch.service.store.samples.partitions import DAY_US, SampleLayout
from stemwatch.service.store.samples.plot_points import PlotPoints, read_plot_points
from stemwatch.service.store.samples.tables import (
    SampleReasonRow,
    SampleRow,
    TagRow,
    instant_of,
    microseconds,
)
from stemwatch.service.store.samples.tag_quality import (
    BadSamples,
    LastGood,
    read_bad,
    read_dead_tags,
    read_last_good,
)
from stemwatch.service.store.storable import clean_text, from_row

log = logging.getLogger(__name__)

_IN_ONE_STATEMENT = 300

Row = TypeVarTuple("Row")


@dataclass(frozen=True, kw_only=True)
class StoredTag:
    """A tag that has samples in the store."""

    id: int
    source: str
    name: str
    unit: str


@dataclass(frozen=True, kw_only=True)
class TagSamples:
    """Samples of one tag in order of time, each of shape (n,): microseconds since 1970 UTC, values
    in the tag's unit, quality."""

    at_us: NDArray[np.int64]
    values: Floats
    quality: QualityCodes


class SampleStore:
    """The stored samples; a ``SampleSink``. Methods raise ``StoreError``.

    ``write`` may be called by one thread of a process at a time; several processes may write.
    """

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions
        self._tags: dict[tuple[str, str], int] = {}
        self._reasons: dict[str, int] = {}
        self._days: set[int] = set()  # days whose partitions this process has created or found

    def write(self, batch: SampleBatch) -> None:
        """Store every sample of ``batch`` that does not exist yet; committed on return. A sample
        whose time occurred twice makes the existing one bad."""
        days = self._prepare(batch)
        try:
            with self._transactions.writing(f"storing samples of {batch.source}") as session:
                tags = self._numbers_of_tags(session, batch)
                reasons = self._numbers_of_reasons(session, batch)
                insert_samples(
                    session.connection(),
                    _columns(batch, tags, reasons),
                    replacing=reasons.get(CAME_TWICE, 0),
                )
        except BaseException:
            # Numbers that the failed transaction assigned may not exist.
            self._tags.clear()
            self._reasons.clear()
            raise
        self._tags.update({(batch.source, name): number for name, number in tags.items()})
        self._reasons.update(reasons)
        self._days |= days

    def describe(self, source: str, units: dict[str, str]) -> None:
        """Store the units of a source's tags."""
        rows = [
            {"source": source, "name": clean_text(name), "unit": unit}
            for name, unit in sorted(units.items())
        ]
        with self._transactions.writing(f"describing the tags of {source}") as session:
            for first in range(0, len(rows), _IN_ONE_STATEMENT):
                part = rows[first : first + _IN_ONE_STATEMENT]
                session.execute(upsert(session, TagRow, part, ("source", "name")))

    def tags(self, source: str) -> list[StoredTag]:
        """The tags of a source, by name."""
        with self._transactions.reading() as session:
            rows = select(TagRow).where(TagRow.source == source).order_by(TagRow.name)
            return [from_row(StoredTag, row) for row in session.scalars(rows)]

    def read(
        self, source: str, tag: str, start: datetime | None = None, stop: datetime | None = None
    ) -> TagSamples:
        """The samples of a tag from ``start`` (inclusive) to ``stop`` (exclusive)."""
        statement = _window(
            select(SampleRow.at_us, SampleRow.value, SampleRow.quality), source, tag, start, stop
        )
        with self._transactions.reading() as session:
            rows = session.execute(statement.order_by(SampleRow.at_us)).all()
        times, values, quality = zip(*rows, strict=True) if rows else ((), (), ())
        return TagSamples(
            at_us=np.array(times, dtype=np.int64),
            values=np.array(values, dtype=np.float64),  # None becomes NaN
            quality=np.array(quality, dtype=np.uint8),
        )

    def bounds(self, source: str, tag: str) -> tuple[datetime, datetime] | None:
        """The instants of a tag's first and last sample."""
        # One statement each: SQLite seeks the end of an index for min or max alone, not for both.
        first = _window(select(func.min(SampleRow.at_us)), source, tag, None, None)
        last = _window(select(func.max(SampleRow.at_us)), source, tag, None, None)
        with self._transactions.reading() as session:
            first_us, last_us = session.scalar(first), session.scalar(last)
        if first_us is None or last_us is None:
            return None
        return instant_of(first_us), instant_of(last_us)

    def has_tag(self, source: str, tag: str) -> bool:
        """Whether the tag ever had a sample, or a unit, in the store."""
        with self._transactions.reading() as session:
            return _tag_number(session, source, tag) is not None

    def plot_points(
        self, source: str, tag: str, start: datetime, stop: datetime, points: int
    ) -> PlotPoints | None:
        """A tag from ``start`` to ``stop`` in about ``points`` points at most; ``None`` for an
        unknown tag."""
        with self._transactions.reading() as session:
            number = _tag_number(session, source, tag)
            return (
                None if number is None else read_plot_points(session, number, start, stop, points)
            )

    def bad(self, source: str, tag: str, start: datetime, stop: datetime) -> BadSamples | None:
        """How many samples of a tag are not good, and why; ``None`` for an unknown tag."""
        with self._transactions.reading() as session:
            number = _tag_number(session, source, tag)
            return None if number is None else read_bad(session, number, tag, start, stop)

    def dead_tags(self, source: str, limit: timedelta, now: datetime) -> dict[str, int]:
        """The numbers of the tags of ``source`` that are polled now but whose samples of the last
        ``limit`` are all bad, by name."""
        with self._transactions.reading() as session:
            return read_dead_tags(session, source, limit, now)

    def last_good(self, tags: Sequence[int], since: datetime) -> dict[int, LastGood]:
        """For each tag number: the last good sample after ``since``, and why the newest is bad."""
        with self._transactions.reading() as session:
            return {number: read_last_good(session, number, since) for number in tags}

    def reasons(
        self, source: str, tag: str, start: datetime | None = None, stop: datetime | None = None
    ) -> dict[str, int]:
        """Why samples of a tag are bad, and how many for each reason."""
        statement = _window(select(SampleReasonRow.words, func.count()), source, tag, start, stop)
        statement = statement.join(SampleReasonRow, SampleReasonRow.id == SampleRow.reason_id)
        with self._transactions.reading() as session:
            rows = session.execute(statement.group_by(SampleReasonRow.words))
            return {words: number for words, number in rows}

    def prepare_days(self, days: frozenset[int] = frozenset()) -> int:
        """Create PostgreSQL's partitions of the coming days and of ``days``; return how many."""
        days_wanted = partitions.wanted_days(days, datetime.now(UTC))
        with self._transactions.writing("making partitions of samples") as session:
            if partitions.layout_of(session.connection()) is not SampleLayout.PARTITIONS:
                return 0
            return partitions.make_days(session.connection(), days_wanted)

    def remove_before(self, instant: datetime, *, whole_days: bool = False) -> int:
        """Remove samples older than ``instant`` and return their number.

        With ``whole_days`` only days that are entirely older (in UTC) are removed, which is quick
        where each day is a partition.
        """
        before_us = microseconds(instant)
        if whole_days:
            before_us -= before_us % DAY_US
        if self._transactions.is_sqlite:
            return self._remove_by_tag(before_us)
        with self._transactions.writing("removing old samples") as session:
            days = _remove_days(session.connection(), before_us)
            removed = session.execute(delete(SampleRow).where(SampleRow.at_us < before_us))
            single_rows: int = removed.rowcount  # type: ignore[attr-defined]  # a DELETE has one
        self._days.clear()
        self.prepare_days()
        return days + single_rows

    def _remove_by_tag(self, before_us: int) -> int:
        removed = 0
        with self._transactions.reading() as session:
            numbers = list(session.scalars(select(TagRow.id)))
        for number in numbers:
            with self._transactions.writing("removing old samples") as session:
                rows_removed = session.execute(
                    delete(SampleRow).where(SampleRow.tag_id == number, SampleRow.at_us < before_us)
                )
                removed += rows_removed.rowcount  # type: ignore[attr-defined]  # a DELETE has one
        return removed

    def _prepare(self, batch: SampleBatch) -> frozenset[int]:
        """Create missing partitions for the days of the batch and return these days. Where that
        fails the samples go into the default partition."""
        if self._transactions.is_sqlite:
            return frozenset()
        days = frozenset(np.unique(np.asarray(batch.at_us) // DAY_US).tolist()) - self._days
        if days:
            try:
                self.prepare_days(days=days)
            except StoreError as error:
                log.warning("samples go into the default partition for now: %s", error)
        return days

    def _numbers_of_tags(self, session: Session, batch: SampleBatch) -> dict[str, int]:
        names = dict.fromkeys(batch.tags)
        number_of_tag = {
            name: self._tags[batch.source, name]
            for name in names
            if (batch.source, name) in self._tags
        }
        new = [name for name in names if name not in number_of_tag]
        for first in range(0, len(new), _IN_ONE_STATEMENT):
            part = new[first : first + _IN_ONE_STATEMENT]
            by_stored = {clean_text(name): name for name in part}
            values = [{"source": batch.source, "name": name, "unit": ""} for name in by_stored]
            session.execute(upsert(session, TagRow, values, ("source", "name"), update=False))
            rows = select(TagRow.name, TagRow.id).where(
                TagRow.source == batch.source, TagRow.name.in_(list(by_stored))
            )
            number_of_tag |= {by_stored[name]: number for name, number in session.execute(rows)}
        return number_of_tag

    def _numbers_of_reasons(self, session: Session, batch: SampleBatch) -> dict[str, int]:
        number_of_reason: dict[str, int] = {}
        for words in dict.fromkeys(batch.reasons):
            if not words:
                continue
            if words in self._reasons:
                number_of_reason[words] = self._reasons[words]
                continue
            value = {"words": words}
            session.execute(upsert(session, SampleReasonRow, [value], ("words",), update=False))
            row = select(SampleReasonRow.id).where(SampleReasonRow.words == words)
            number_of_reason[words] = session.execute(row).scalar_one()
        return number_of_reason


def _columns(batch: SampleBatch, tags: dict[str, int], reasons: dict[str, int]) -> SampleColumns:
    count = len(batch)
    reason = (reasons.get(words, 0) for words in batch.reasons)
    return SampleColumns(
        tag=np.fromiter(map(tags.__getitem__, batch.tags), np.int64, count),
        at_us=np.asarray(batch.at_us),
        values=np.asarray(batch.values),
        quality=np.asarray(batch.quality),
        reason=np.fromiter(reason, np.int64, count) if reasons else np.zeros(count, np.int64),
    )


def _remove_days(connection: Connection, before_us: int) -> int:
    layout = partitions.layout_of(connection)
    if layout is SampleLayout.PARTITIONS:
        return partitions.drop_days(connection, before_us // DAY_US)
    if layout is not SampleLayout.HYPERTABLE:
        return 0
    whole_us = before_us - before_us % DAY_US
    rows = select(func.count()).select_from(SampleRow).where(SampleRow.at_us < whole_us)
    rows_removed = connection.execute(rows).scalar_one()
    connection.execute(text(partitions.drop_chunks(whole_us)))
    return rows_removed


def _tag_number(session: Session, source: str, tag: str) -> int | None:
    conditions = (TagRow.source == source, TagRow.name == clean_text(tag))
    return session.scalar(select(TagRow.id).where(*conditions))


def _window(
    statement: Select[*Row],
    source: str,
    tag: str,
    start: datetime | None,
    stop: datetime | None,
) -> Select[*Row]:
    number = (
        select(TagRow.id)
        .where(TagRow.source == source, TagRow.name == clean_text(tag))
        .scalar_subquery()
    )
    statement = statement.select_from(SampleRow).where(SampleRow.tag_id == number)
    if start is not None:
        statement = statement.where(SampleRow.at_us >= microseconds(start))
    if stop is not None:
        statement = statement.where(SampleRow.at_us < microseconds(stop))
    return statement
