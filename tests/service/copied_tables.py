"""The tables of a new SQLite file, which hundreds of tests need, made once in each process.

Tests of the store (`tests/service/store`) make every file as the program does.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from sqlalchemy import Engine

from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.migrations import migrate

UPGRADE = migrate.upgrade


class TablesCopied:
    """``upgrade`` of a database, for which a SQLite file that does not exist begins as a copy of
    the one that this upgraded first, ``template``."""

    def __init__(self, template: Path) -> None:
        self._template = template

    def __call__(self, engine: Engine, address: DatabaseUrl) -> None:
        """Copy the tables where there are none, and upgrade as the program does."""
        file = Path(engine.url.database or "") if engine.dialect.name == "sqlite" else None
        if file is not None and file.name and file.parent.is_dir() and not file.exists():
            self._copy_to(file)
        UPGRADE(engine, address)

    def _copy_to(self, file: Path) -> None:
        if not self._template.exists():
            from stemwatch.service.store.database.engine import make_engine

            own = DatabaseUrl(f"sqlite:///{self._template}")
            engine = make_engine(own)
            UPGRADE(engine, own)
            engine.dispose()
        try:
            file.touch(0o600)
            with (
                closing(sqlite3.connect(self._template)) as tables,
                closing(sqlite3.connect(file)) as new,
            ):
                tables.backup(new)
        except (OSError, sqlite3.Error):
            return  # where no file can be written it is the program that says so
