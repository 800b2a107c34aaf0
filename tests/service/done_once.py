"""What hundreds of tests would each have done again, done once in each process that runs them: the
screening of a recording that was screened before, and the tables of a new SQLite file.

Tests of screening, of the order of work and of migrations ask the functions themselves.
"""

from __future__ import annotations

import pickle
import sqlite3
from collections.abc import Sequence
from contextlib import closing
from hashlib import sha256
from pathlib import Path

from sqlalchemy import Engine

from stemwatch.models.screening import screen as screening
from stemwatch.models.screening_result import Screening
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.migrations import migrate

SCREEN, UPGRADE = screening.screen, migrate.upgrade
_screened: dict[bytes, bytes] = {}


def screen_once(
    cases: Sequence[screening.Case], options: screening.Options = screening.DEFAULTS
) -> list[Screening]:
    """``screen``, which is asked the first time that it gets these very cases and options."""
    asked = sha256(pickle.dumps((list(cases), options))).digest()
    if asked not in _screened:
        _screened[asked] = pickle.dumps(SCREEN(cases, options))
    answer: list[Screening] = pickle.loads(_screened[asked])
    return answer


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
            with (
                closing(sqlite3.connect(self._template)) as tables,
                closing(sqlite3.connect(file)) as new,
            ):
                tables.backup(new)
        except sqlite3.Error:
            return  # where no file can be written it is the program that says so
