"""Partitions of the samples in PostgreSQL: one for each day in UTC, or a TimescaleDB hypertable.

Partitions are created some days ahead and dropped whole when they are too old, which is quick
whatever their size. Samples of a day without a partition go into ``samples_default`` and are read
like any other. SQLite has one plain table.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from enum import StrEnum

from sqlalchemy import Connection, text

from stemwatch.service.store.samples.tables import EPOCH

DAY_US = 86_400_000_000
DAYS_AHEAD = 7
MOST_DAYS_BACK = 400  # older samples lie in the default partition
DEFAULT = "samples_default"
_PREFIX = "samples_2"  # samples_20260301
_LOCK = 0x57E3_DA15  # any number of our own: PostgreSQL's advisory lock for partitions
_LOCK_WAIT = "5s"  # creating a partition waits for readers, and meanwhile other writers wait
_KIND = text("SELECT relkind FROM pg_class WHERE oid = to_regclass('samples')")
_HYPERTABLE = text(
    "SELECT count(*) FROM timescaledb_information.hypertables "
    "WHERE hypertable_name = 'samples' AND hypertable_schema = current_schema()"
)
_EXTENSION = text("SELECT extversion FROM pg_extension WHERE extname = 'timescaledb'")
_CHILDREN = text(
    "SELECT child.relname FROM pg_inherits "
    "JOIN pg_class AS child ON child.oid = pg_inherits.inhrelid "
    "WHERE pg_inherits.inhparent = to_regclass('samples') ORDER BY child.relname"
)


class SampleLayout(StrEnum):
    """How the table of samples is stored."""

    PLAIN = "plain table"
    PARTITIONS = "partitions by day"
    HYPERTABLE = "TimescaleDB hypertable"


def layout_of(connection: Connection) -> SampleLayout:
    """How the samples of this database are stored."""
    if connection.dialect.name != "postgresql":
        return SampleLayout.PLAIN
    if connection.execute(_KIND).scalar() in ("p", b"p"):
        return SampleLayout.PARTITIONS
    if timescale_version(connection) and connection.execute(_HYPERTABLE).scalar():
        return SampleLayout.HYPERTABLE
    return SampleLayout.PLAIN


def timescale_version(connection: Connection) -> str | None:
    """The version of TimescaleDB in this PostgreSQL database, ``None`` without it."""
    version: str | None = connection.execute(_EXTENSION).scalar()
    return version


def is_partition(table: str) -> bool:
    """Whether ``table`` is a partition of ``samples``."""
    return table == DEFAULT or (table.startswith(_PREFIX) and table[8:].isdigit())


def partition_name(day: int) -> str:
    """The partition of the ``day``-th day since 1970-01-01 in UTC."""
    return f"samples_{EPOCH + timedelta(days=day):%Y%m%d}"


def day_of(instant: datetime) -> int:
    """The day of an instant, counted from 1970-01-01 in UTC."""
    return (instant - EPOCH) // timedelta(days=1)


def existing_days(connection: Connection) -> dict[int, str]:
    """The name of the partition of each day that has one."""
    names = connection.execute(_CHILDREN).scalars()
    return {_day_named(name): name for name in names if name != DEFAULT and is_partition(name)}


def wanted_days(days: Iterable[int], now: datetime) -> set[int]:
    """The days that need a partition: the coming ones, and those of ``days`` that are near today.

    The limit keeps a device with a wrong clock from creating thousands of tables.
    """
    today = day_of(now)
    near_days = {day for day in days if today - MOST_DAYS_BACK <= day <= today + DAYS_AHEAD}
    return near_days | set(range(today, today + DAYS_AHEAD + 1))


def make_days(connection: Connection, days: Iterable[int]) -> int:
    """Create the missing partitions of ``days``, move samples of these days out of the default
    partition, and return how many were created. Other writers wait for the end of the transaction.

    Raises SQLAlchemy's ``OperationalError`` where the table is in use for more than five seconds.
    """
    missing = set(days) - set(existing_days(connection))
    if not missing:
        return 0
    connection.execute(text(f"SET LOCAL lock_timeout = '{_LOCK_WAIT}'"))
    connection.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})
    missing -= set(existing_days(connection))  # another process may have created some meanwhile
    occupied = _days_in_default(connection, missing)
    for day in sorted(missing):
        for statement in _statements(day, occupied=day in occupied):
            connection.execute(text(statement))
    return len(missing)


def drop_days(connection: Connection, before: int) -> int:
    """Drop the partitions of all days before day ``before``; return how many samples they held."""
    connection.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})
    old = [name for day, name in sorted(existing_days(connection).items()) if day < before]
    rows_removed = sum(_rows_of(connection, name) for name in old)
    if old:
        connection.execute(text(f"SET LOCAL lock_timeout = '{_LOCK_WAIT}'"))
        connection.execute(text(f"DROP TABLE {', '.join(old)}"))
    return rows_removed


def drop_chunks(before_us: int) -> str:
    """The statement that drops the chunks of a hypertable that end before ``before_us``."""
    return f"SELECT drop_chunks('samples', older_than => BIGINT '{before_us}')"


def _day_named(name: str) -> int:
    return day_of(datetime.strptime(name.removeprefix("samples_"), "%Y%m%d").replace(tzinfo=UTC))


def _rows_of(connection: Connection, table: str) -> int:
    return int(connection.execute(text(f"SELECT count(*) FROM {table}")).scalar_one())


def _days_in_default(connection: Connection, days: set[int]) -> set[int]:
    rows = connection.execute(
        text(
            f"SELECT DISTINCT floor(at_us::numeric / {DAY_US})::bigint FROM {DEFAULT} "
            "WHERE at_us >= :first AND at_us < :stop"
        ),
        {"first": min(days, default=0) * DAY_US, "stop": (max(days, default=0) + 1) * DAY_US},
    )
    return {int(day) for day in rows.scalars()} & days


def _statements(day: int, *, occupied: bool) -> list[str]:
    name = partition_name(day)
    first, stop = day * DAY_US, (day + 1) * DAY_US
    bounds = f"FOR VALUES FROM ({first}) TO ({stop})"
    if not occupied:
        return [f"CREATE TABLE {name} PARTITION OF samples {bounds}"]
    return [
        f"CREATE TABLE {name} (LIKE {DEFAULT} INCLUDING ALL)",
        f"WITH moved AS (DELETE FROM {DEFAULT} WHERE at_us >= {first} AND at_us < {stop} "
        f"RETURNING *) INSERT INTO {name} SELECT * FROM moved",
        f"ALTER TABLE samples ATTACH PARTITION {name} {bounds}",
    ]
