"""Insert many samples at once: COPY in PostgreSQL, one prepared statement in SQLite.

Samples that exist already are skipped, so that a repeated batch changes nothing; only a sample
whose time occurred twice replaces the existing one. COPY cannot skip rows; it fills a temporary
table, from which one INSERT copies them. Measured by ``tests/benchmarks/bench_storage.py``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection

from stemwatch.models.recording import Floats
from stemwatch.service.store.database.engine import driver_errors

_COLUMNS = "tag_id, at_us, value, quality, reason_id"
_SQLITE = f"INSERT OR IGNORE INTO samples ({_COLUMNS}) VALUES (?, ?, ?, ?, ?)"
_ARRIVING = (
    "CREATE TEMPORARY TABLE IF NOT EXISTS stemwatch_arriving (tag_id integer, at_us bigint, "
    "value double precision, quality smallint, reason_id integer) ON COMMIT DELETE ROWS"
)
_COPY = f"COPY pg_temp.stemwatch_arriving ({_COLUMNS}) FROM STDIN (FORMAT BINARY)"
# In the order of the key, so that concurrent writers wait for one another and cannot deadlock.
_CARRY_OVER = (
    f"INSERT INTO samples ({_COLUMNS}) SELECT tag_id, at_us, nullif(value, 'NaN'), quality, "
    "nullif(reason_id, 0) FROM pg_temp.stemwatch_arriving ORDER BY tag_id, at_us "
    "ON CONFLICT DO NOTHING"
)
_SQLITE_REPLACE = (
    "UPDATE samples SET value = NULL, quality = ?, reason_id = ? WHERE tag_id = ? AND at_us = ?"
)
_REPLACE = (
    "UPDATE samples SET value = NULL, quality = new.quality, reason_id = new.reason_id "
    "FROM pg_temp.stemwatch_arriving AS new WHERE new.reason_id = %s "
    "AND samples.tag_id = new.tag_id AND samples.at_us = new.at_us"
)
# PostgreSQL's binary row: the number of fields, then each field after its length in bytes.
_FORMAT = np.dtype(
    [
        *(("fields", ">i2"), ("tag_bytes", ">i4"), ("tag", ">i4"), ("at_bytes", ">i4")),
        *(("at", ">i8"), ("value_bytes", ">i4"), ("value", ">f8"), ("quality_bytes", ">i4")),
        *(("quality", ">i2"), ("reason_bytes", ">i4"), ("reason", ">i4")),
    ]
)
_LENGTHS = {
    "tag_bytes": 4, "at_bytes": 8, "value_bytes": 8, "quality_bytes": 2, "reason_bytes": 4,
}  # fmt: skip
_HEAD = b"PGCOPY\n\xff\r\n\x00" + bytes(8)
_END = b"\xff\xff"
_ROWS_AT_ONCE = 200_000  # 9 MB


@dataclass(frozen=True, kw_only=True, eq=False)
class SampleColumns:
    """``n`` samples as columns of the table, each of shape (n,).

    ``tag`` numbers of tags, ``at_us`` microseconds since 1970 UTC, ``values`` NaN where missing,
    ``quality``, ``reason`` numbers of reasons, 0 for none.
    """

    tag: NDArray[np.int64]
    at_us: NDArray[np.int64]
    values: Floats
    quality: NDArray[np.integer]
    reason: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.at_us)


def insert_samples(
    connection: Connection,
    columns: SampleColumns,
    *,
    more_follow: bool = False,
    replacing: int = 0,
) -> None:
    """Insert the samples that do not exist yet. Raises what the driver raises.

    Samples with the reason ``replacing`` take the place of those that exist. Set ``more_follow``
    where the same transaction will insert again.
    """
    if not len(columns):
        return
    if connection.dialect.name == "sqlite":
        connection.exec_driver_sql(_SQLITE, _rows(columns))
        if replacing:
            to_replace = np.flatnonzero(columns.reason == replacing)
            sample_columns = (columns.quality, columns.reason, columns.tag, columns.at_us)
            rows = list(
                zip(*(column[to_replace].tolist() for column in sample_columns), strict=True)
            )
            connection.exec_driver_sql(_SQLITE_REPLACE, rows)
        return
    driver = connection.connection.driver_connection
    assert driver is not None
    with driver_errors(connection), driver.cursor() as cursor:
        cursor.execute(_ARRIVING)
        with cursor.copy(_COPY) as copy:
            copy.write(_HEAD)
            for first in range(0, len(columns), _ROWS_AT_ONCE):
                copy.write(_binary(columns, slice(first, first + _ROWS_AT_ONCE)))
            copy.write(_END)
        cursor.execute(_CARRY_OVER)
        if replacing:
            cursor.execute(_REPLACE, (replacing,))
        if more_follow:  # otherwise the end of the transaction empties it
            cursor.execute("TRUNCATE pg_temp.stemwatch_arriving")


def _rows(columns: SampleColumns) -> list[tuple[object, ...]]:
    values: list[float | None] = columns.values.tolist()
    for row in np.flatnonzero(~np.isfinite(columns.values)):
        values[row] = None
    reasons: list[int | None] = columns.reason.tolist()
    for row in np.flatnonzero(columns.reason == 0):
        reasons[row] = None
    numbers = (columns.tag.tolist(), columns.at_us.tolist(), values, columns.quality.tolist())
    return list(zip(*numbers, reasons, strict=True))


def _binary(columns: SampleColumns, part: slice) -> bytes:
    rows = np.empty(len(columns.at_us[part]), dtype=_FORMAT)
    rows["fields"] = len(_LENGTHS)
    for name, length in _LENGTHS.items():
        rows[name] = length
    values = columns.values[part]
    rows["tag"], rows["at"] = columns.tag[part], columns.at_us[part]
    rows["value"] = np.where(np.isfinite(values), values, np.nan)
    rows["quality"], rows["reason"] = columns.quality[part], columns.reason[part]
    return rows.tobytes()
