"""Fill an empty database from a backup or another database, completely or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Protocol

import numpy as np
import pyarrow as pa
import sqlalchemy as sa
from alembic import command
from sqlalchemy import Connection, Engine, inspect

from stemwatch.service.store.administration.backup_file import TableDigest
from stemwatch.service.store.administration.row_batches import (
    Digest,
    count_rows,
    digest_of,
    read_batches,
)
from stemwatch.service.store.administration.schema import (
    SAMPLES,
    ColumnKind,
    DatabaseSchema,
    TableSchema,
    schema_of,
)
from stemwatch.service.store.database.engine import driver_errors, for_writing, store_errors
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.migrations.migrate import config_for, refuse_newer, wait_for_others
from stemwatch.service.store.samples import partitions
from stemwatch.service.store.samples.bulk_insert import SampleColumns, insert_samples
from stemwatch.service.store.samples.partitions import DAY_US, SampleLayout


class RowSource(Protocol):
    """Where rows come from; ``promised`` holds rows and digest of each table where known before."""

    schema: DatabaseSchema
    promised: dict[str, TableDigest]

    def batches(self, table: TableSchema) -> Iterator[pa.RecordBatch]:
        """All rows of a table in the order of its key."""
        ...


def fill(engine: Engine, address: DatabaseUrl, source: RowSource) -> dict[str, TableDigest]:
    """Copy all rows of ``source`` into the empty database, and upgrade its schema.

    Tables are created at the schema of the source and filled; each is read back and its digest
    compared; then the migrations run over the data. All of it is one transaction: an error leaves
    the database unchanged. Raises ``StoreError`` for a database that is not empty, for a source of
    a newer version, and where a table read back differs from the source.
    """
    with store_errors(address, "filling the store"), for_writing(engine).begin() as connection:
        wait_for_others(connection)
        if source.schema.revision is None:
            raise StoreError("the source has no tables of stemwatch: there is nothing to copy")
        refuse_newer(source.schema.revision, "the source")
        _refuse_occupied(connection, address)
        config = config_for(connection)
        if schema_of(connection).revision is not None:
            command.downgrade(config, "base")
        command.upgrade(config, source.schema.revision)
        digests = {}
        for table in schema_of(connection).tables:
            digests[table.name] = _copy_table(connection, source, table)
        if connection.dialect.name == "postgresql":
            _continue_numbering(connection, source.schema)
        command.upgrade(config, "head")
    return digests


def _refuse_occupied(connection: Connection, address: DatabaseUrl) -> None:
    schema = schema_of(connection)
    rows = {table.name: count_rows(connection, table.name) for table in schema.tables}
    occupied = [f"{name} {count}" for name, count in rows.items() if count]
    if occupied:
        raise StoreError(
            f"{address}: is not empty (rows: {', '.join(occupied)}); nothing was changed. Give an "
            "empty database, or move this one away"
        )


def _copy_table(connection: Connection, source: RowSource, table: TableSchema) -> TableDigest:
    described = {table.name: table for table in source.schema.tables}.get(table.name)
    if described is None or set(described.columns) != set(table.columns):
        raise StoreError(f"{table.name}: the source has other columns than its schema says")
    digest = Digest(table)
    for batch in source.batches(described):
        digest.update(batch)
        _insert(connection, table, batch)
    read = _table_digest(digest)
    _compare(table.name, "on the way", source.promised.get(table.name), read)
    stored = _table_digest(digest_of(table, read_batches(connection, table)))
    _compare(table.name, "in the database", read, stored)
    return stored


def _table_digest(digest: Digest) -> TableDigest:
    return TableDigest(rows=digest.rows, digest=digest.hexdigest())


def _compare(name: str, location: str, expected: TableDigest | None, digest: TableDigest) -> None:
    if expected is not None and expected != digest:
        raise StoreError(
            f"{name}: {digest.rows} rows with digest {digest.digest[:12]} {location}, expected "
            f"{expected.rows} with {expected.digest[:12]}; nothing was changed"
        )


def _insert(connection: Connection, table: TableSchema, batch: pa.RecordBatch) -> None:
    if not batch.num_rows:
        return
    if table.name == SAMPLES:
        _insert_samples(connection, batch)
    elif connection.dialect.name == "sqlite":
        _insert_sqlite(connection, table, batch)
    else:
        _copy_postgres(connection, table, batch)


def _insert_samples(connection: Connection, batch: pa.RecordBatch) -> None:
    columns = SampleColumns(
        tag=_numbers(batch, "tag_id", 0),
        at_us=_numbers(batch, "at_us", 0),
        values=_numbers(batch, "value", np.nan),
        quality=_numbers(batch, "quality", 0),
        reason=_numbers(batch, "reason_id", 0),
    )
    if partitions.layout_of(connection) is SampleLayout.PARTITIONS:
        days = np.unique(columns.at_us // DAY_US).tolist()
        partitions.make_days(connection, partitions.wanted_days(days, datetime.now(UTC)))
    insert_samples(connection, columns, more_follow=True)


def _numbers(batch: pa.RecordBatch, name: str, null_value: float) -> np.ndarray:
    values: np.ndarray = batch.column(name).fill_null(null_value).to_numpy(zero_copy_only=False)
    return values


def _insert_sqlite(connection: Connection, table: TableSchema, batch: pa.RecordBatch) -> None:
    names = [column.name for column in table.columns]
    columns = [
        _as_sqlite(batch.column(column.name).to_pylist(), column.kind) for column in table.columns
    ]
    marks = ", ".join("?" * len(names))
    quoted = ", ".join(f'"{name}"' for name in names)
    statement = f'INSERT INTO "{table.name}" ({quoted}) VALUES ({marks})'
    connection.exec_driver_sql(statement, list(zip(*columns, strict=True)))


def _as_sqlite(values: list[object], kind: ColumnKind) -> list[object]:
    if kind is ColumnKind.TIME:  # as SQLAlchemy writes it
        return [
            value.strftime("%Y-%m-%d %H:%M:%S.%f") if isinstance(value, datetime) else None
            for value in values
        ]
    return values


def _copy_postgres(connection: Connection, table: TableSchema, batch: pa.RecordBatch) -> None:
    driver = connection.connection.driver_connection
    assert driver is not None
    names = ", ".join(f'"{column.name}"' for column in table.columns)
    columns = [batch.column(column.name).to_pylist() for column in table.columns]
    with (
        driver_errors(connection),
        driver.cursor() as cursor,
        cursor.copy(f'COPY "{table.name}" ({names}) FROM STDIN') as copy,
    ):
        for row in zip(*columns, strict=True):
            copy.write_row(row)


def _continue_numbering(connection: Connection, schema: DatabaseSchema) -> None:
    """Set PostgreSQL's sequences behind the largest number of each table."""
    for table in schema.tables:
        if table.key != ("id",) or table.name not in inspect(connection).get_table_names():
            continue
        owned = sa.text("SELECT pg_get_serial_sequence(:name, 'id')")
        if (sequence := connection.execute(owned, {"name": table.name}).scalar()) is None:
            continue
        newest = connection.execute(sa.text(f'SELECT max(id) FROM "{table.name}"')).scalar()
        if newest is not None:
            connection.execute(
                sa.text("SELECT setval(:sequence, :newest)"),
                {"sequence": sequence, "newest": newest},
            )
