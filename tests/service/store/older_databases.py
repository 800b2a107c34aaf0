"""Databases as older versions left them: their migrations run, and a row or two in every table.

Rows are written by plain SQL into whatever tables and columns are there, so that this needs no
code of the versions that wrote them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import sqlalchemy as sa
from alembic import command
from sqlalchemy import Connection, Engine, inspect, text

from stemwatch.service.store.database.engine import for_writing, make_engine
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.migrations.migrate import config_for
from stemwatch.service.store.samples.partitions import is_partition

AT_US = 1_772_344_800_000_000  # 2026-03-01 06:00 UTC
DAY_US = 86_400_000_000
TIME = "2026-03-01 06:00:00.000000"
# From the first on every migration is gone through; those between begin in the long tests.
_BETWEEN = ("0002", "0003", "0004", "0005", "0006")
REVISIONS = ("0001", *(pytest.param(item, marks=pytest.mark.long) for item in _BETWEEN), "0007")
# What a column holds where its type alone does not say it; a list has a value for each row.
_SPECIAL: dict[str, Any] = {
    "valves.id": ["FIC-101", "FIC-1ü2"],
    "*.valve": "FIC-101",
    "run_valves.valve": ["FIC-101", "FIC-1ü2"],
    "runs.counts": '{"sticky": 1}',
    "runs.state": "done",
    "runs.schedule": ["nightly", None],
    "runs.asked": '["FIC-101"]',
    "screenings.window_key": ["one", "two"],
    "screenings.verdict": ["sticky", "healthy"],
    "screenings.shape": "undershoot",
    "screenings.grade_reasons": '["3 gaps"]',
    "screenings.residuals": '{"stiction": {"rmse": 0.4, "normalised": 0.2, "one_step": null}}',
    "screenings.still_seen": "[]",
    "screenings.decisions": '["comma", "ü"]',
    "screenings.mismatch_slugs": None,
    "screenings.mismatch": [None, "null"],
    "screenings.s_percent": [3.1, 1e-300],
    "screenings.s_reason": None,
    "screenings.j_percent": None,
    "feedback.judgement": ["right", "wrong"],
    "feedback.verdict": "sticky",
    "feedback.effects": "[]",
    "pictures.screening_id": [1, 2],
    "networks.kind": ["baseline", "fitted"],
    "samples.at_us": [AT_US, AT_US + DAY_US],
    "samples.value": [41.25, None],
    "samples.quality": [0, 2],
    "samples.reason_id": [None, 1],
    "alerts.closed": [None, TIME],
    "alerts.source": None,
    "schedules.areas": "[]",
    "schedules.units": "[]",
    "schedules.valves": "[]",
}


@contextmanager
def database_at(url: str, revision: str, *, rows: bool = True) -> Iterator[Engine]:
    """An engine for a database that the migrations up to ``revision`` made, with rows in it."""
    engine = make_engine(DatabaseUrl(url))
    try:
        with for_writing(engine).begin() as connection:
            command.upgrade(config_for(connection), revision)
            if rows:
                for name in tables_of(connection):
                    _insert(connection, name)
        yield engine
    finally:
        engine.dispose()


def tables_of(connection: Connection) -> list[str]:
    """The tables, parents first, without partitions."""
    inspector = inspect(connection)
    ordered = [name for name, _ in inspector.get_sorted_table_and_fkc_names() if name]
    hidden = {"alembic_version"}
    return [name for name in ordered if name not in hidden and not is_partition(name)]


def contents(engine: Engine) -> dict[str, dict[str, list[str]]]:
    """Every value of every table as text: by table and column, in the order of the key."""
    with engine.connect() as connection:
        return {name: _contents_of(connection, name) for name in tables_of(connection)}


def _contents_of(connection: Connection, name: str) -> dict[str, list[str]]:
    inspector = inspect(connection)
    columns = [column["name"] for column in inspector.get_columns(name)]
    key = inspector.get_pk_constraint(name)["constrained_columns"]
    quoted = ", ".join(f'"{column}"' for column in columns)
    order = ", ".join(f'"{column}"' for column in key)
    rows = connection.execute(text(f'SELECT {quoted} FROM "{name}" ORDER BY {order}')).all()
    return {column: [repr(row[index]) for row in rows] for index, column in enumerate(columns)}


def _insert(connection: Connection, name: str) -> None:
    inspector = inspect(connection)
    linked = {
        column for key in inspector.get_foreign_keys(name) for column in key["constrained_columns"]
    }
    for number in (1, 2):
        values = {
            column["name"]: _value(name, column, number, column["name"] in linked)
            for column in inspector.get_columns(name)
        }
        names = ", ".join(f'"{column}"' for column in values)
        marks = ", ".join(f":{column}" for column in values)
        connection.execute(text(f'INSERT INTO "{name}" ({names}) VALUES ({marks})'), values)
    if connection.dialect.name == "postgresql":
        _continue_numbering(connection, name)


def _value(table: str, column: Any, number: int, is_link: bool) -> Any:
    for key in (f"{table}.{column['name']}", f"*.{column['name']}"):
        if key in _SPECIAL:
            special = _SPECIAL[key]
            return special[number - 1] if isinstance(special, list) else special
    kind = column["type"]
    if isinstance(kind, sa.Boolean):
        return number == 1
    if isinstance(kind, sa.Integer):
        return 1 if is_link and column["name"] != "tag_id" else number
    if isinstance(kind, sa.Numeric | sa.Float):
        return 0.1 * number
    if isinstance(kind, sa.JSON):
        return '{"a": [1, null, "\\u00fc ü"]}'
    if isinstance(kind, sa.DateTime):
        return TIME
    if isinstance(kind, sa.LargeBinary):
        return b"\x00\xff" * number
    return f"{table} {column['name']} {number} ü"


def _continue_numbering(connection: Connection, name: str) -> None:
    owned = text("SELECT pg_get_serial_sequence(:name, 'id')")
    columns = {column["name"] for column in inspect(connection).get_columns(name)}
    if "id" in columns and (sequence := connection.execute(owned, {"name": name}).scalar()):
        connection.execute(text("SELECT setval(:sequence, 2)"), {"sequence": sequence})
