"""The tables and columns of a database as they are; its schema may be older than the program's."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import pyarrow as pa
import sqlalchemy as sa
from sqlalchemy import Connection, ForeignKey, inspect
from sqlalchemy.types import TypeEngine

from stemwatch.service.store.all_tables import metadata
from stemwatch.service.store.database.columns import UtcDateTime
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.migrations.migrate import current_revision

SAMPLES = "samples"


class ColumnKind(StrEnum):
    """The type of a column, independent of the database."""

    WHOLE = "whole number"
    NUMBER = "number"
    TEXT = "text"
    JSON = "json"
    TIME = "time"
    YES_NO = "yes or no"
    BYTES = "bytes"


# The first match counts.
_KINDS: tuple[tuple[type[TypeEngine[Any]], ColumnKind], ...] = (
    (sa.Boolean, ColumnKind.YES_NO),
    (sa.Integer, ColumnKind.WHOLE),
    (sa.Float, ColumnKind.NUMBER),
    (sa.Numeric, ColumnKind.NUMBER),
    (sa.JSON, ColumnKind.JSON),
    (sa.DateTime, ColumnKind.TIME),
    (sa.LargeBinary, ColumnKind.BYTES),
    (sa.String, ColumnKind.TEXT),
)
_ARROW = {
    ColumnKind.WHOLE: pa.int64(),
    ColumnKind.NUMBER: pa.float64(),
    ColumnKind.TEXT: pa.string(),
    ColumnKind.JSON: pa.string(),  # the text unchanged: parsing and writing JSON could alter it
    ColumnKind.TIME: pa.timestamp("us", tz="UTC"),
    ColumnKind.YES_NO: pa.bool_(),
    ColumnKind.BYTES: pa.binary(),
}


@dataclass(frozen=True, kw_only=True)
class TableColumn:
    """A column of a table as a backup stores it: its name, and its type in Parquet."""

    name: str
    kind: ColumnKind

    @property
    def arrow(self) -> pa.DataType:
        """The Arrow type of its values."""
        return _ARROW[self.kind]

    @property
    def sql(self) -> TypeEngine[Any]:
        """The SQL type as which its values are read; JSON as text."""
        types: dict[ColumnKind, TypeEngine[Any]] = {
            ColumnKind.WHOLE: sa.BigInteger(),
            ColumnKind.NUMBER: sa.Double(),
            ColumnKind.TIME: UtcDateTime(),
            ColumnKind.YES_NO: sa.Boolean(),
            ColumnKind.BYTES: sa.LargeBinary(),
        }
        return types.get(self.kind, sa.Text())


@dataclass(frozen=True, kw_only=True)
class TableReference:
    """A foreign key: ``columns`` of ``table`` refer to ``parent_columns`` of ``parent``."""

    table: str
    columns: tuple[str, ...]
    parent: str
    parent_columns: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class TableSchema:
    """A table: its columns sorted by name, and the columns of its primary key."""

    name: str
    columns: tuple[TableColumn, ...]
    key: tuple[str, ...]

    @property
    def schema(self) -> pa.Schema:
        """The Arrow schema of its batches."""
        return pa.schema([(column.name, column.arrow) for column in self.columns])

    @property
    def is_heavy(self) -> bool:
        """Whether single rows may be large: networks, and the JSON of a mismatch."""
        return any(column.kind in (ColumnKind.BYTES, ColumnKind.JSON) for column in self.columns)


@dataclass(frozen=True, kw_only=True)
class DatabaseSchema:
    """The tables of a database at schema ``revision``, referenced tables first."""

    revision: str | None
    tables: tuple[TableSchema, ...]


def schema_of(connection: Connection) -> DatabaseSchema:
    """The tables of the store in this database; tables of other programs are ignored."""
    inspector = inspect(connection)
    present_tables = set(inspector.get_table_names()) & set(metadata.tables)
    in_order = [table.name for table in metadata.sorted_tables if table.name in present_tables]
    return DatabaseSchema(
        revision=current_revision(connection),
        tables=tuple(_table(inspector, name) for name in in_order),
    )


def foreign_keys_of_metadata() -> list[TableReference]:
    """The foreign keys that the code declares, also where the database lacks them."""
    return [
        _link(name, key)
        for name, table in metadata.tables.items()
        for column in table.columns
        for key in column.foreign_keys
    ]


def _link(name: str, key: ForeignKey) -> TableReference:
    return TableReference(
        table=name,
        columns=(key.parent.name,),
        parent=key.column.table.name,
        parent_columns=(key.column.name,),
    )


def _table(inspector: sa.Inspector, name: str) -> TableSchema:
    columns = [
        TableColumn(name=column["name"], kind=_kind(name, column["name"], column["type"]))
        for column in inspector.get_columns(name)
    ]
    return TableSchema(
        name=name,
        columns=tuple(sorted(columns, key=lambda column: column.name)),
        key=tuple(inspector.get_pk_constraint(name)["constrained_columns"]),
    )


def _kind(table: str, column: str, type_: TypeEngine[Any]) -> ColumnKind:
    for base, kind in _KINDS:
        if isinstance(type_, base):
            return kind
    raise StoreError(f"{table}.{column} is of type {type_}, which no version of stemwatch made")
