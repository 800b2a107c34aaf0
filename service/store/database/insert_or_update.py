"""``upsert``: insert or update in one statement, safe with concurrent writers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

from sqlalchemy import Executable
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session

from stemwatch.service.store.database.columns import TableBase

_Insert = sqlite.Insert | postgresql.Insert


def upsert(
    session: Session,
    table: type[TableBase],
    values: Sequence[dict[str, Any]],
    key: Sequence[str],
    *,
    update: bool = True,
    condition: Any = None,
    returning: Any = None,
) -> Executable:
    """The statement that inserts ``values`` into ``table``. An existing row with the same ``key``
    is updated, or left as it is with ``update=False``.

    ``condition`` is the condition of the unique index over ``key``, if it is a partial index.
    """
    # SQLAlchemy compiles a statement of several rows each time, one of a single row only once.
    is_sqlite = session.get_bind().dialect.name == "sqlite"  # the only other one is PostgreSQL
    insert = _insert_into(table, is_sqlite).values(values[0] if len(values) == 1 else values)
    excluded = _excluded(table, is_sqlite)
    changed = {name: excluded[name] for name in values[0] if name not in key}
    if update and changed:
        statement = insert.on_conflict_do_update(
            index_elements=key, index_where=condition, set_=changed
        )
    else:
        statement = insert.on_conflict_do_nothing(index_elements=key, index_where=condition)
    return statement if returning is None else statement.returning(returning)


def _insert_into(table: type[TableBase], is_sqlite: bool) -> _Insert:
    return sqlite.insert(table) if is_sqlite else postgresql.insert(table)


@cache
def _excluded(table: type[TableBase], is_sqlite: bool) -> Mapping[str, Any]:
    """The columns of the row that was not inserted, by name: the same of every statement, but made
    anew by each, which takes longer than all the rest of it."""
    return dict(_insert_into(table, is_sqlite).excluded.items())
