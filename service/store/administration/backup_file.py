"""The backup file: a zip of Parquet files with a whole database, from either engine.

``manifest.json`` holds the form of the file, the schema, the time, the database it was made from,
and rows and digest of each table; ``tables/NAME.parquet`` holds the rows, readable by any program
that reads Parquet.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from sqlalchemy import Connection

from stemwatch.service import __version__
from stemwatch.service.store.administration.row_batches import Digest, read_batches
from stemwatch.service.store.administration.schema import (
    ColumnKind,
    DatabaseSchema,
    TableColumn,
    TableSchema,
    schema_of,
)
from stemwatch.service.store.errors import StoreError

FORM = 1
_MANIFEST = "manifest.json"


@dataclass(frozen=True, kw_only=True)
class TableDigest:
    """How many rows of a table were copied, and their SHA-256."""

    rows: int
    digest: str


class LiveDatabase:
    """A database as source of a backup or copy, read within one transaction."""

    def __init__(self, connection: Connection) -> None:
        self.schema = schema_of(connection)
        self.promised: dict[
            str, TableDigest
        ] = {}  # not known beforehand: digests are computed while copying
        self._connection = connection

    def batches(self, table: TableSchema) -> Iterator[pa.RecordBatch]:
        """All rows of a table in the order of its key."""
        return read_batches(self._connection, table)


class BackupFile:
    """A backup file as source of a restore. Raises ``StoreError`` where it is not a backup or is
    damaged."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._zip = _opened(path)
        try:
            self._read_manifest()
        except (KeyError, TypeError, ValueError, AttributeError, zipfile.BadZipFile) as error:
            self._zip.close()
            raise StoreError(
                f"{path}: no backup of stemwatch: it has no readable {_MANIFEST}"
            ) from error
        except StoreError:
            self._zip.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._zip.close()

    def batches(self, table: TableSchema) -> Iterator[pa.RecordBatch]:
        """All rows of a table in the order of its key."""
        try:
            with self._zip.open(_member(table.name)) as file:
                yield from pq.ParquetFile(file).iter_batches(
                    batch_size=50_000, columns=[column.name for column in table.columns]
                )
        except (KeyError, zipfile.BadZipFile, pa.ArrowException, OSError) as error:
            raise StoreError(f"{self._path}: {table.name} is damaged: {error}") from error

    def _read_manifest(self) -> None:
        manifest = json.loads(self._zip.read(_MANIFEST))
        if manifest["form"] != FORM:
            raise StoreError(
                f"{self._path}: written by a newer stemwatch (form {manifest['form']}; this "
                f"version reads form {FORM}). Install the newer version."
            )
        self.made, self.made_by = str(manifest["made"]), str(manifest["software_version"])
        tables = manifest["tables"]
        self.schema = DatabaseSchema(
            revision=manifest["schema"],
            tables=tuple(_table(name, described) for name, described in tables.items()),
        )
        self.promised = {
            name: TableDigest(rows=table["rows"], digest=table["digest"])
            for name, table in tables.items()
        }


@contextmanager
def reading_archive(path: Path) -> Iterator[BackupFile]:
    """The archive; it is closed at the end of the block."""
    source = BackupFile(path)
    try:
        yield source
    finally:
        source.close()


def write_archive(source: LiveDatabase, path: Path, described: str) -> dict[str, TableDigest]:
    """Write ``source`` to ``path``, completely or not at all, readable by its owner only.

    ``described`` names the database, without a password. Raises ``StoreError`` where the file
    exists already, or cannot be written.
    """
    if path.exists():
        raise StoreError(f"{path}: there is a file already; give another name, or move it away")
    part = path.with_name(f"{path.name}.part")
    digests: dict[str, TableDigest] = {}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(part, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(handle, "wb") as file:
            with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
                for table in source.schema.tables:
                    digests[table.name] = _write_table(source, table, archive)
                archive.writestr(_MANIFEST, _manifest_text(source, digests, described))
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError as error:
        raise StoreError(
            f"{path}: the backup could not be written ({error.strerror or error}) and is not "
            "there; make room on its disk, or choose another folder, and run again"
        ) from error
    finally:
        with suppress(OSError):  # its folder may be a file
            part.unlink(missing_ok=True)
    return digests


def _write_table(source: LiveDatabase, table: TableSchema, archive: zipfile.ZipFile) -> TableDigest:
    digest = Digest(table)
    with (
        archive.open(_member(table.name), "w", force_zip64=True) as file,
        pq.ParquetWriter(file, table.schema, compression="zstd") as writer,
    ):
        for batch in source.batches(table):
            digest.update(batch)
            writer.write_batch(batch)
    return TableDigest(rows=digest.rows, digest=digest.hexdigest())


def _manifest_text(source: LiveDatabase, digests: dict[str, TableDigest], described: str) -> str:
    manifest = {
        "form": FORM,
        "schema": source.schema.revision,
        "software_version": __version__,
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "database": described,
        "tables": {
            table.name: {
                "rows": digests[table.name].rows,
                "digest": digests[table.name].digest,
                "key": table.key,
                "columns": {column.name: column.kind.value for column in table.columns},
            }
            for table in source.schema.tables
        },
    }
    return json.dumps(manifest, indent=1)


def _table(name: str, described: dict[str, Any]) -> TableSchema:
    columns = tuple(
        TableColumn(name=column, kind=ColumnKind(kind))
        for column, kind in described["columns"].items()
    )
    return TableSchema(name=name, columns=columns, key=tuple(described["key"]))


def _member(name: str) -> str:
    return f"tables/{name}.parquet"


def _opened(path: Path) -> zipfile.ZipFile:
    try:
        return zipfile.ZipFile(path)
    except FileNotFoundError:
        raise StoreError(f"{path}: there is no such file") from None
    except zipfile.BadZipFile as error:
        raise StoreError(
            f"{path}: no backup of stemwatch, or one that was cut short: {error}"
        ) from None
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror or error}") from None
