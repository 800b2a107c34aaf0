"""The rows of a table as Arrow batches, and a digest that is the same on SQLite and PostgreSQL."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pyarrow as pa
import sqlalchemy as sa
from sqlalchemy import Connection

from stemwatch.service.store.administration.schema import ColumnKind, TableColumn, TableSchema

_LIGHT_ROWS, _HEAVY_ROWS = 50_000, 500
_PARTS = ("there", "lengths", "values")  # the three byte streams of a column in the digest


class Digest:
    """SHA-256 over the rows of one table in the order of its key, column by column.

    It depends neither on the size of the batches nor on the database: times are microseconds in
    UTC, numbers eight bytes (zero without its sign, which SQLite does not store), texts UTF-8.
    """

    def __init__(self, table: TableSchema) -> None:
        self.rows = 0
        self._streams = {
            (column.name, part): hashlib.sha256() for column in table.columns for part in _PARTS
        }

    def update(self, batch: pa.RecordBatch) -> None:
        """Add the next rows."""
        self.rows += batch.num_rows
        for name in batch.schema.names:
            for part, data in zip(_PARTS, _bytes_of(batch.column(name)), strict=True):
                self._streams[name, part].update(data)

    def hexdigest(self) -> str:
        """The digest of all rows so far."""
        total_hash = hashlib.sha256()
        for name, part in sorted(self._streams):
            total_hash.update(f"{name}.{part}\0".encode() + self._streams[name, part].digest())
        return total_hash.hexdigest()


def read_batches(connection: Connection, table: TableSchema) -> Iterator[pa.RecordBatch]:
    """All rows of ``table`` in the order of its key, a batch at a time."""
    size = _HEAVY_ROWS if table.is_heavy else _LIGHT_ROWS
    rows_of = _select(connection, table).execution_options(stream_results=True)
    with connection.execute(rows_of) as result:
        for rows in result.partitions(size):
            yield batch_of(table, rows)


def digest_of(table: TableSchema, batches: Iterable[pa.RecordBatch]) -> Digest:
    """The digest of all ``batches``."""
    digest = Digest(table)
    for batch in batches:
        digest.update(batch)
    return digest


def count_rows(connection: Connection, name: str) -> int:
    """How many rows a table has."""
    rows = sa.select(sa.func.count()).select_from(sa.table(name))
    return int(connection.execute(rows).scalar_one())


def batch_of(table: TableSchema, rows: Iterable[Iterable[object]]) -> pa.RecordBatch:
    """Rows of a database, columns in the order of ``table``, as one batch."""
    columns = list(zip(*rows, strict=True)) or [() for _ in table.columns]
    arrays = [
        pa.array(values, type=column.arrow)
        for column, values in zip(table.columns, columns, strict=True)
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=table.schema)


def _select(connection: Connection, table: TableSchema) -> sa.Select[tuple[object, ...]]:
    source = sa.table(table.name, *(sa.column(column.name, column.sql) for column in table.columns))
    is_postgres = connection.dialect.name == "postgresql"
    columns = [
        sa.cast(source.c[column.name], sa.Text())
        if is_postgres and column.kind is ColumnKind.JSON
        else source.c[column.name]
        for column in table.columns
    ]
    order = [_ordered(source.c[column.name], column, is_postgres) for column in _key(table)]
    return sa.select(*columns).order_by(*order)


def _key(table: TableSchema) -> list[TableColumn]:
    by_name = {column.name: column for column in table.columns}
    return [by_name[name] for name in table.key]


def _ordered(
    column: sa.ColumnElement[Any], described: TableColumn, is_postgres: bool
) -> sa.ColumnElement[Any]:
    # By bytes, as SQLite does; PostgreSQL would sort by the rules of a language.
    return sa.collate(column, "C") if is_postgres and described.kind is ColumnKind.TEXT else column


def _bytes_of(column: pa.Array) -> tuple[bytes, bytes, bytes]:
    """A column as bytes: which values are there, how long they are, the values."""
    not_null = column.is_valid().to_numpy(zero_copy_only=False).tobytes()
    kind = column.type
    if pa.types.is_string(kind) or pa.types.is_binary(kind):
        texts = column.cast(pa.binary()).fill_null(b"").to_pylist()
        lengths = np.fromiter(map(len, texts), "<i8", len(texts))
        return not_null, lengths.tobytes(), b"".join(texts)
    if pa.types.is_timestamp(kind):
        column = column.cast(pa.int64())
    if pa.types.is_floating(kind):
        values = column.fill_null(0.0).to_numpy(zero_copy_only=False) + 0.0
        return not_null, b"", values.astype("<f8").tobytes()
    filled = column.fill_null(False if pa.types.is_boolean(kind) else 0)
    return not_null, b"", filled.to_numpy(zero_copy_only=False).astype("<i8").tobytes()
