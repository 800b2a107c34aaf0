"""Commands that only read never make a database, and an empty one is an error."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.store import open_existing_store, open_store


def test_a_mistyped_address_makes_nothing(stemwatch, tmp_path: Path) -> None:
    """`maintenance-report`, `maintenance` and `db prune` say where they looked, with status 2."""
    file = tmp_path / "nope.db"
    address = f"sqlite:///{file}"
    for command in (
        ("maintenance-report", "--out", tmp_path / "pages"),
        ("maintenance", "FIC-101", "--note", "packing renewed"),
        ("db", "prune", "--alerts-days", 30),
        ("db", "check"),
    ):
        outcome = stemwatch(*command, "--db", address)
        assert outcome.status == 2, command
        assert f"there is no database at {file}" in outcome.said
        assert not file.exists()
    assert not (tmp_path / "pages").exists()


def test_a_database_of_nobody_is_an_error(tmp_path: Path) -> None:
    """A file without our tables gets none by being read."""
    file = tmp_path / "empty.db"
    file.touch()
    with pytest.raises(StoreError, match="this database is empty"):
        open_existing_store(f"sqlite:///{file}")
    with sqlite3.connect(file) as connection:
        assert connection.execute("SELECT count(*) FROM sqlite_master").fetchone() == (0,)


def test_a_store_without_a_screening_gives_no_report(stemwatch, tmp_path: Path) -> None:
    """It would say that no valve needs work."""
    address = f"sqlite:///{tmp_path / 'new.db'}"
    open_store(address).close()
    outcome = stemwatch("maintenance-report", "--db", address, "--out", tmp_path / "pages")
    assert outcome.status == 2
    assert "no valve was screened into this database yet" in outcome.said
    assert not (tmp_path / "pages").exists()
