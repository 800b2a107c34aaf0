"""``stemwatch db check``: schema, integrity, dangling references, partitions, numbering, sizes.

Nothing is changed; databases of older schemas are checked as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import Connection, inspect, text

from stemwatch.models.words import counted
from stemwatch.service.store.administration.backup import disposing, one_instant
from stemwatch.service.store.administration.row_batches import count_rows
from stemwatch.service.store.administration.schema import (
    DatabaseSchema,
    foreign_keys_of_metadata,
    schema_of,
)
from stemwatch.service.store.database.engine import existing_engine
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.migrations import views_v1, views_v2
from stemwatch.service.store.migrations.migrate import newest_revision
from stemwatch.service.store.samples import partitions
from stemwatch.service.store.samples.partitions import SampleLayout

_INVALID = text("SELECT indexrelid::regclass::text FROM pg_index WHERE NOT indisvalid")
_AVAILABLE = text("SELECT default_version FROM pg_available_extensions WHERE name = 'timescaledb'")
_SIZE = text(
    "SELECT greatest(pg_total_relation_size(to_regclass(:name)), "
    "(SELECT sum(pg_total_relation_size(relid)) FROM pg_partition_tree(to_regclass(:name))))"
)
_SIZE_OF_HYPERTABLE = text("SELECT coalesce(hypertable_size('samples'), 0)")
_SERIAL = text("SELECT pg_get_serial_sequence(:name, 'id')")


@dataclass(frozen=True, kw_only=True)
class TableSize:
    """A table, its rows, and its bytes on disk with indexes (``None`` for SQLite)."""

    name: str
    rows: int
    size_bytes: int | None


@dataclass(frozen=True, kw_only=True)
class DatabaseHealth:
    """The result of a check. ``problems`` need action; ``notes`` are for information."""

    engine: str
    schema: str | None
    newest: str
    layout: SampleLayout
    tables: tuple[TableSize, ...]
    size_bytes: int
    problems: tuple[str, ...]
    notes: tuple[str, ...]


def check(address: DatabaseUrl, now: datetime | None = None) -> DatabaseHealth:
    """Check the database. Raises ``StoreError`` where it cannot be reached or read."""
    with disposing(existing_engine(address)) as engine, one_instant(engine, address) as connection:
        schema, newest = schema_of(connection), newest_revision()
        layout = partitions.layout_of(connection)
        problems = [
            *_schema(schema, newest),
            *_integrity(connection),
            *_orphans(connection, schema),
            *_views(connection, schema, newest),
        ]
        notes: list[str] = []
        if connection.dialect.name == "postgresql":
            problems += [*_numbering(connection, schema)]
            notes += [*_partitions(connection, layout, now or datetime.now(UTC))]
        return DatabaseHealth(
            engine=_engine(connection),
            schema=schema.revision,
            newest=newest,
            layout=layout,
            tables=tuple(_sizes(connection, schema, layout)),
            size_bytes=_whole_size(connection),
            problems=tuple(problems),
            notes=tuple(notes),
        )


def _engine(connection: Connection) -> str:
    version = ".".join(map(str, connection.dialect.server_version_info or ()))
    name = {"sqlite": "SQLite", "postgresql": "PostgreSQL"}[connection.dialect.name]
    timescale = "" if name == "SQLite" else partitions.timescale_version(connection)
    return f"{name} {version}" + (f" with TimescaleDB {timescale}" if timescale else "")


def _schema(schema: DatabaseSchema, newest: str) -> Iterator[str]:
    if schema.revision is None:
        yield "there are no tables of stemwatch; the first screening or `db upgrade` makes them"
    elif schema.revision < newest:
        yield f"the schema is {schema.revision}, older than {newest}: run `stemwatch db upgrade`"
    elif schema.revision > newest:
        yield (
            f"the schema {schema.revision} is that of a newer stemwatch, this one knows {newest}: "
            "install the newer version"
        )


def _integrity(connection: Connection) -> Iterator[str]:
    if connection.dialect.name == "sqlite":
        lines = connection.execute(text("PRAGMA integrity_check")).scalars().all()
        yield from (f"SQLite says: {line}" for line in lines if line != "ok")
    else:
        for name in connection.execute(_INVALID).scalars():
            yield f"the index {name} is not valid: REINDEX INDEX {name}"


def _orphans(connection: Connection, schema: DatabaseSchema) -> Iterator[str]:
    columns = {table.name: {column.name for column in table.columns} for table in schema.tables}
    for link in foreign_keys_of_metadata():
        column, parent_column = link.columns[0], link.parent_columns[0]
        if column not in columns.get(link.table, ()) or link.parent not in columns:
            continue
        count = connection.execute(
            text(
                f'SELECT count(*) FROM (SELECT DISTINCT "{column}" AS named FROM "{link.table}") '
                f'AS child LEFT JOIN "{link.parent}" AS parent '
                f'ON parent."{parent_column}" = child.named '
                f'WHERE child.named IS NOT NULL AND parent."{parent_column}" IS NULL'
            )
        ).scalar_one()
        if count:
            yield (
                f"{link.table}.{column} names {counted(count, 'row')} of {link.parent} that "
                f"{'is' if count == 1 else 'are'} not there; "
                "restore a backup, or ask for help with this sentence"
            )


def _views(connection: Connection, schema: DatabaseSchema, newest: str) -> Iterator[str]:
    if schema.revision == newest:
        missing = sorted(
            set(views_v1.NAMES + views_v2.NAMES) - set(inspect(connection).get_view_names())
        )
        if missing:
            yield f"views are missing: {', '.join(missing)}; `db downgrade 0004`, then `db upgrade`"


def _numbering(connection: Connection, schema: DatabaseSchema) -> Iterator[str]:
    for table in schema.tables:
        if table.key != ("id",):
            continue
        sequence = connection.execute(_SERIAL, {"name": table.name}).scalar()
        if sequence is None:
            continue
        newest = connection.execute(text(f'SELECT max(id) FROM "{table.name}"')).scalar() or 0
        last = connection.execute(text(f"SELECT last_value FROM {sequence}")).scalar_one()
        if newest > last:
            yield (
                f"{table.name}: the next number, after {last}, is taken (up to {newest}): "
                f"SELECT setval('{sequence}', {newest})"
            )


def _partitions(connection: Connection, layout: SampleLayout, now: datetime) -> Iterator[str]:
    if layout is SampleLayout.PARTITIONS:
        days = partitions.existing_days(connection)
        today = partitions.day_of(now)
        names = [days[day] for day in sorted(days)]
        day_range = f", {names[0]} to {names[-1]}" if names else ""
        yield f"samples: {len(names)} partitions by day{day_range}"
        if stray := count_rows(connection, partitions.DEFAULT):
            yield f"samples: {stray} rows lie in {partitions.DEFAULT}, outside the days"
        if names and not {today, today + 1} <= set(days):
            yield "samples: tomorrow has no partition yet; a running service makes it"
        if version := connection.execute(_AVAILABLE).scalar():
            yield (
                f"TimescaleDB {version} could be installed in this database; see docs/storage.md "
                "for what it changes"
            )


def _sizes(
    connection: Connection, schema: DatabaseSchema, layout: SampleLayout
) -> Iterator[TableSize]:
    for table in schema.tables:
        size: int | None = None
        if table.name == "samples" and layout is SampleLayout.HYPERTABLE:
            size = int(connection.execute(_SIZE_OF_HYPERTABLE).scalar_one())
        elif connection.dialect.name == "postgresql":
            size = int(connection.execute(_SIZE, {"name": table.name}).scalar_one())
        yield TableSize(name=table.name, rows=count_rows(connection, table.name), size_bytes=size)


def _whole_size(connection: Connection) -> int:
    if connection.dialect.name == "postgresql":
        size = connection.execute(text("SELECT pg_database_size(current_database())"))
        return int(size.scalar_one())
    pages = connection.execute(text("PRAGMA page_count")).scalar_one()
    return int(pages) * int(connection.execute(text("PRAGMA page_size")).scalar_one())
