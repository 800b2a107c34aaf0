"""Which tables a database has, as it is: its schema may be older than this program."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import pyarrow as pa
import sqlalchemy as sa
from sqlalchemy import Connection, ForeignKey, inspect
from sqlalchemy.types import TypeEngine

from stemwatch.service.store.administration.migrate import current_revision
from stemwatch.service.store.all_tables import metadata
from stemwatch.service.store.database.columns import UtcDateTime
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.samples.partitions import is_partition

SAMPLES = "samples"


class Kind(StrEnum):
    """What a column holds, whichever database it is in."""

    WHOLE = "whole number"
    NUMBER = "number"
    TEXT = "text"
    JSON = "json"
    TIME = "time"
    YES_NO = "yes or no"
    BYTES = "bytes"


# In this order: a boolean of SQLite is a kind of integer to nobody but SQLite.
_KINDS: tuple[tuple[type[TypeEngine[Any]], Kind], ...] = (
    (sa.Boolean, Kind.YES_NO),
    (sa.Integer, Kind.WHOLE),
    (sa.Float, Kind.NUMBER),
    (sa.Numeric, Kind.NUMBER),
    (sa.JSON, Kind.JSON),
    (sa.DateTime, Kind.TIME),
    (sa.LargeBinary, Kind.BYTES),
    (sa.String, Kind.TEXT),
)
_ARROW = {
    Kind.WHOLE: pa.int64(),
    Kind.NUMBER: pa.float64(),
    Kind.TEXT: pa.string(),
    Kind.JSON: pa.string(),  # the very text: JSON that is read and written again may differ
    Kind.TIME: pa.timestamp("us", tz="UTC"),
    Kind.YES_NO: pa.bool_(),
    Kind.BYTES: pa.binary(),
}


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column of a table."""

    name: str
    kind: Kind

    @property
    def arrow(self) -> pa.DataType:
        """How its values lie in a batch."""
        return _ARROW[self.kind]

    @property
    def sql(self) -> TypeEngine[Any]:
        """As what its values are read; JSON as the text that it is."""
        types: dict[Kind, TypeEngine[Any]] = {
            Kind.WHOLE: sa.BigInteger(),
            Kind.NUMBER: sa.Double(),
            Kind.TIME: UtcDateTime(),
            Kind.YES_NO: sa.Boolean(),
            Kind.BYTES: sa.LargeBinary(),
        }
        return types.get(self.kind, sa.Text())


@dataclass(frozen=True, kw_only=True)
class Link:
    """A foreign key: ``columns`` of ``table`` name rows of ``parent`` by ``parent_columns``."""

    table: str
    columns: tuple[str, ...]
    parent: str
    parent_columns: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table: its columns in the order of their names, and which of them are its key."""

    name: str
    columns: tuple[Column, ...]
    key: tuple[str, ...]

    @property
    def schema(self) -> pa.Schema:
        """The Arrow schema of its batches."""
        return pa.schema([(column.name, column.arrow) for column in self.columns])

    @property
    def is_heavy(self) -> bool:
        """Whether single rows may be large: networks, and what explains a valve."""
        return any(column.kind in (Kind.BYTES, Kind.JSON) for column in self.columns)


@dataclass(frozen=True, kw_only=True)
class Shape:
    """The tables of a database at schema ``revision``, parents before those that name them."""

    revision: str | None
    tables: tuple[Table, ...]

    def table(self, name: str) -> Table:
        """The table of this name. Raises ``KeyError``."""
        return {table.name: table for table in self.tables}[name]


def shape_of(connection: Connection) -> Shape:
    """The tables of the store in this database. Tables of other programs are passed over."""
    inspector = inspect(connection)
    there = set(inspector.get_table_names()) & set(metadata.tables)
    in_order = [table.name for table in metadata.sorted_tables if table.name in there]
    return Shape(
        revision=current_revision(connection),
        tables=tuple(_table(inspector, name) for name in in_order),
    )


def links_of_metadata() -> list[Link]:
    """The foreign keys of the tables in code: also those that a database does without."""
    return [
        _link(name, key)
        for name, table in metadata.tables.items()
        for column in table.columns
        for key in column.foreign_keys
    ]


def _link(name: str, key: ForeignKey) -> Link:
    return Link(
        table=name,
        columns=(key.parent.name,),
        parent=key.column.table.name,
        parent_columns=(key.column.name,),
    )


def _table(inspector: sa.Inspector, name: str) -> Table:
    columns = [
        Column(name=column["name"], kind=_kind(name, column["name"], column["type"]))
        for column in inspector.get_columns(name)
    ]
    return Table(
        name=name,
        columns=tuple(sorted(columns, key=lambda column: column.name)),
        key=tuple(inspector.get_pk_constraint(name)["constrained_columns"]),
    )


def _kind(table: str, column: str, found: TypeEngine[Any]) -> Kind:
    for base, kind in _KINDS:
        if isinstance(found, base):
            return kind
    raise StoreError(f"{table}.{column} is of type {found}, which no version of stemwatch made")


def parts_of_samples(connection: Connection) -> list[str]:
    """The partitions of samples, by name."""
    return sorted(name for name in inspect(connection).get_table_names() if is_partition(name))
