"""Backups, and copies from one engine to the other: all of it, bit for bit, or nothing."""

from __future__ import annotations

import json
import stat
import zipfile
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sqlalchemy import text

from stemwatch.service.store.administration.backup import (
    backup,
    copy,
    disposing,
    one_instant,
    restore,
)
from stemwatch.service.store.administration.row_batches import Digest, batch_of, read_batches
from stemwatch.service.store.administration.schema import (
    ColumnKind,
    TableColumn,
    TableSchema,
    schema_of,
)
from stemwatch.service.store.database.engine import make_engine
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.store import open_store
from tests.service.store.older_databases import REVISIONS, database_at

NewDatabase = Callable[[str], str]
ENGINES = ["sqlite", pytest.param("postgresql", marks=pytest.mark.postgres)]
WAYS = [
    pytest.param("sqlite", "sqlite", marks=pytest.mark.long),
    pytest.param("sqlite", "postgresql", marks=pytest.mark.postgres),
    pytest.param("postgresql", "sqlite", marks=[pytest.mark.postgres, pytest.mark.long]),
    pytest.param("postgresql", "postgresql", marks=[pytest.mark.postgres, pytest.mark.long]),
]


def rows_of(url: str) -> dict[str, list[dict[str, object]]]:
    """Every row of every table, the same from either engine."""
    address = DatabaseUrl(url)
    with disposing(make_engine(address)) as engine, one_instant(engine, address) as connection:
        return {
            table.name: pa.Table.from_batches(
                read_batches(connection, table), table.schema
            ).to_pylist()
            for table in schema_of(connection).tables
        }


def numbers_go_on(url: str) -> None:
    """What is written next gets numbers of its own."""
    with open_store(url) as store:
        assert store.begin_run(software_version="2") == 3
        store.set_baseline("FIC-101", b"n", reason="first healthy window")
        store.add_note("FIC-101", datetime(2026, 3, 1, tzinfo=UTC), "n")


@pytest.mark.long
@pytest.mark.parametrize(("origin", "target"), WAYS)
def test_a_copy_has_every_value(new_database: NewDatabase, origin: str, target: str) -> None:
    """Each table comes over with every row and value, and the copy works on."""
    first, second = new_database(origin), new_database(target)
    with database_at(first, "0013"):
        result = copy(DatabaseUrl(first), DatabaseUrl(second))
    assert rows_of(first) == rows_of(second)
    assert {2} == {item.rows for item in result.values()}
    numbers_go_on(second)


@pytest.mark.parametrize(("origin", "target"), WAYS)
def test_a_backup_is_restored_on_either_engine(
    new_database: NewDatabase, tmp_path: Path, origin: str, target: str
) -> None:
    """One form of file for both engines; only its owner may read it."""
    first, second, file = new_database(origin), new_database(target), tmp_path / "to" / "b.zip"
    with database_at(first, "0013"):
        written = backup(DatabaseUrl(first), file)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert written == restore(file, DatabaseUrl(second))
    assert rows_of(first) == rows_of(second)
    numbers_go_on(second)


@pytest.mark.long
@pytest.mark.parametrize(
    ("revision", "engine"),
    [
        (REVISIONS[0], "sqlite"),
        pytest.param(REVISIONS[-1], "sqlite", marks=pytest.mark.long),
        pytest.param(REVISIONS[0], "postgresql", marks=[pytest.mark.postgres, pytest.mark.long]),
        pytest.param(REVISIONS[-1], "postgresql", marks=pytest.mark.postgres),
    ],
)
def test_a_backup_of_an_older_schema_is_brought_up(
    new_database: NewDatabase, tmp_path: Path, revision: str, engine: str
) -> None:
    """A database is backed up as it is, before the upgrade; restoring migrates the data."""
    first, second, file = new_database("sqlite"), new_database(engine), tmp_path / "b.zip"
    with database_at(first, revision):
        backup(DatabaseUrl(first), file)
    restore(file, DatabaseUrl(second))
    with open_store(first):  # brings the original up
        pass
    assert rows_of(first) == rows_of(second)


def test_a_database_with_rows_is_left_alone(store_url: str, tmp_path: Path) -> None:
    """Restoring over a database in use is refused, with what is in it."""
    file = tmp_path / "b.zip"
    with database_at(store_url, "0013"):
        backup(DatabaseUrl(store_url), file)
        before = rows_of(store_url)
        with pytest.raises(StoreError, match=r"is not empty \(rows: .*valves 2.*nothing was"):
            restore(file, DatabaseUrl(store_url))
        assert before == rows_of(store_url)


@pytest.mark.long
def test_an_opened_but_empty_database_may_be_filled(
    new_database: NewDatabase, store_url: str, tmp_path: Path
) -> None:
    """Tables without rows are no obstacle."""
    first, file = new_database("sqlite"), tmp_path / "b.zip"
    with database_at(first, "0003"):
        backup(DatabaseUrl(first), file)
    open_store(store_url).close()
    restore(file, DatabaseUrl(store_url))
    assert len(rows_of(store_url)["valves"]) == 2


def test_a_changed_backup_is_refused_and_nothing_is_kept(
    new_database: NewDatabase, store_url: str, tmp_path: Path
) -> None:
    """A row that was changed in the file shows in the digest; the database stays empty."""
    first, file, forged = new_database("sqlite"), tmp_path / "b.zip", tmp_path / "c.zip"
    with database_at(first, "0013"):
        backup(DatabaseUrl(first), file)
    with zipfile.ZipFile(file) as good, zipfile.ZipFile(forged, "w") as bad:
        manifest = json.loads(good.read("manifest.json"))
        manifest["tables"]["networks"]["digest"] = "0" * 64
        for name in good.namelist():
            content = json.dumps(manifest) if name == "manifest.json" else good.read(name)
            bad.writestr(name, content)
    with pytest.raises(StoreError, match=r"networks: 2 rows with digest .* nothing was changed"):
        restore(forged, DatabaseUrl(store_url))
    assert rows_of(store_url) == {}


def test_a_file_that_is_cut_short_is_named(new_database: NewDatabase, tmp_path: Path) -> None:
    """Half a file, a missing file and any other zip are told from a backup."""
    first, file, target = new_database("sqlite"), tmp_path / "b.zip", DatabaseUrl("sqlite://")
    with database_at(first, "0013"):
        backup(DatabaseUrl(first), file)
    half = tmp_path / "half.zip"
    half.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(StoreError, match=r"half.zip: no backup .* cut short"):
        restore(half, target)
    with pytest.raises(StoreError, match="there is no such file"):
        restore(tmp_path / "none.zip", target)
    with pytest.raises(StoreError, match="cannot be read: Is a directory"):
        restore(tmp_path, target)


@pytest.mark.parametrize(
    "manifest", [None, "no JSON", "[1]", '{"form": 1}', '{"form": 1, "made": "", "tables": []}']
)
def test_another_zip_is_told_from_a_backup(tmp_path: Path, manifest: str | None) -> None:
    """Also one with a manifest of its own."""
    other = tmp_path / "other.zip"
    with zipfile.ZipFile(other, "w") as into:
        into.writestr("a.txt" if manifest is None else "manifest.json", manifest or "")
    with pytest.raises(StoreError, match=r"no backup of stemwatch: it has no readable manifest"):
        restore(other, DatabaseUrl("sqlite://"))


def test_a_backup_that_has_no_place_is_named(new_database: NewDatabase, tmp_path: Path) -> None:
    """Its folder cannot be made, because there is a file of that name."""
    (tmp_path / "file").write_text("")
    first = new_database("sqlite")
    with database_at(first, "0013"), pytest.raises(StoreError, match="could not be written"):
        backup(DatabaseUrl(first), tmp_path / "file" / "b.zip")


def test_a_newer_backup_is_refused(new_database: NewDatabase, tmp_path: Path) -> None:
    """A backup of a schema that this program does not know asks for the newer program."""
    first, file = new_database("sqlite"), tmp_path / "b.zip"
    with database_at(first, "0013") as engine:
        with engine.begin() as connection:
            connection.execute(text("UPDATE alembic_version SET version_num = '9999'"))
        backup(DatabaseUrl(first), file)
    with pytest.raises(StoreError, match=r"newer stemwatch \(schema 9999.*Install the newer"):
        restore(file, DatabaseUrl(new_database("sqlite")))


def test_backups_overwrite_nothing_and_need_a_database(
    new_database: NewDatabase, tmp_path: Path
) -> None:
    """A file that is there stays; a database that is not there is not made."""
    first, file = new_database("sqlite"), tmp_path / "b.zip"
    with pytest.raises(StoreError, match="there is no database at"):
        backup(DatabaseUrl(first), file)
    assert not Path(first.removeprefix("sqlite:///")).exists()
    file.write_text("mine")
    with database_at(first, "0013"), pytest.raises(StoreError, match="there is a file already"):
        backup(DatabaseUrl(first), file)
    assert file.read_text() == "mine"
    with pytest.raises(StoreError, match="is the database itself"):
        copy(DatabaseUrl(first), DatabaseUrl(first))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_backup_holds_one_instant(new_database: NewDatabase, engine: str, tmp_path: Path) -> None:
    """What is written while a backup is being read is not in it, not even in part."""
    url = new_database(engine)
    with (
        database_at(url, "0013") as theirs,
        one_instant(theirs, DatabaseUrl(url)) as connection,
        open_store(url) as store,
    ):
        tables = {table.name: table for table in schema_of(connection).tables}
        before = [batch.num_rows for batch in read_batches(connection, tables["valves"])]
        store.add_note("FIC-999", datetime(2026, 3, 1, tzinfo=UTC), "later")
        after = [batch.num_rows for batch in read_batches(connection, tables["notes"])]
    assert (before, after) == ([2], [2])


VALUES = st.tuples(
    st.integers(-(2**63), 2**63 - 1),
    st.none() | st.floats(allow_nan=False),
    st.none() | st.text(max_size=5),
    st.none() | st.binary(max_size=5),
    st.none() | st.booleans(),
    st.none() | st.datetimes(timezones=st.just(UTC)),
)
KINDS = (
    ColumnKind.WHOLE,
    ColumnKind.NUMBER,
    ColumnKind.TEXT,
    ColumnKind.BYTES,
    ColumnKind.YES_NO,
    ColumnKind.TIME,
)
TABLE = TableSchema(
    name="any",
    columns=tuple(TableColumn(name=kind.name, kind=kind) for kind in KINDS),
    key=("WHOLE",),
)


@settings(deadline=None)
@given(rows=st.lists(VALUES, min_size=1, max_size=8), cut=st.integers(0, 8))
def test_where_batches_end_makes_no_difference_to_a_digest(
    rows: list[tuple[object, ...]], cut: int
) -> None:
    """The same rows in one batch or in two have one digest."""
    complete, parts = Digest(TABLE), Digest(TABLE)
    complete.update(batch_of(TABLE, rows))
    for part in (rows[:cut], rows[cut:]):
        parts.update(batch_of(TABLE, part))
    assert (complete.rows, complete.hexdigest()) == (parts.rows, parts.hexdigest())


@settings(deadline=None)
@given(row=VALUES, other=VALUES)
def test_different_rows_have_different_digests(
    row: tuple[object, ...], other: tuple[object, ...]
) -> None:
    """A digest tells rows apart that differ in anything but the sign of zero."""
    first, second = Digest(TABLE), Digest(TABLE)
    first.update(batch_of(TABLE, [row]))
    second.update(batch_of(TABLE, [other]))
    assert (first.hexdigest() == second.hexdigest()) == (row == other)
