"""``stemwatch db`` on a SQLite site: what a person at a plant's computer does with it."""

from __future__ import annotations

import errno
import sqlite3
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from stemwatch.service.store.database.engine import make_engine
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.migrations.migrate import downgrade, newest_revision
from stemwatch.service.store.store import open_store
from tests.service.web.example_plant import NOW, fill, plant_of, write_samples

SECRET = "s3cr3t-pa55"
NOWHERE = f"postgresql://anna:{SECRET}@127.0.0.1:1/stemwatch"


@pytest.fixture
def site(tmp_path: Path) -> str:
    """The URL of a site with three months of screenings and a day of samples."""
    url = f"sqlite:///{tmp_path / 'site.db'}"
    with open_store(url) as store:
        fill(store)
        write_samples(store)
        plant_of(tmp_path, store)
    return url


def rows_in(url: str, table: str) -> int:
    """How many rows a table of a SQLite site has."""
    with closing(sqlite3.connect(url.removeprefix("sqlite:///"))) as connection:
        return connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0]


def test_an_empty_database_is_not_to_be_backed_up_first(stemwatch, tmp_path: Path) -> None:
    """There is nothing to back up; what is next is the tables."""
    with closing(sqlite3.connect(tmp_path / "new.db")) as connection:
        connection.execute("VACUUM")
    outcome = stemwatch("db", "version", "--db", f"sqlite:///{tmp_path / 'new.db'}")
    assert "schema none" in outcome.said
    assert "`stemwatch db upgrade`, or the first start of the service" in outcome.said
    assert "backup" not in outcome.said


def test_version_upgrade_and_downgrade(stemwatch, site: str) -> None:
    """Which schema there is, back to an older one only when asked twice, and up again."""
    newest = newest_revision()
    assert (
        f"schema {newest}; this program writes {newest}"
        in stemwatch("db", "version", "--db", site).said
    )
    process = stemwatch("db", "downgrade", "0004", "--db", site)
    assert process.status == 2
    assert "would be lost: make a backup" in process.said
    assert stemwatch("db", "downgrade", "0004", "--yes", "--db", site).status == 0
    older = stemwatch("db", "check", "--db", site)
    assert older.status == 1
    assert f"older than {newest}: run `stemwatch db upgrade`" in older.said
    assert "schema 0004;" in stemwatch("db", "version", "--db", site).said
    assert stemwatch("db", "upgrade", "--db", site).status == 0
    assert stemwatch("db", "check", "--db", site).status == 0


def test_the_version_of_a_newer_program_leads_to_that_program(stemwatch, site: str) -> None:
    """An upgrade by this program is not offered: it would be refused."""
    with closing(sqlite3.connect(site.removeprefix("sqlite:///"))) as connection:
        connection.execute("UPDATE alembic_version SET version_num = '9999'")
        connection.commit()
    said = stemwatch("db", "version", "--db", site).said
    assert "schema 9999;" in said
    taken_back = f"by `stemwatch db downgrade {newest_revision()}`"
    words = " ".join(said.split())
    assert f"install that version, or take the schema back with it, {taken_back}" in words
    assert "db upgrade" not in said
    refused = stemwatch("db", "downgrade", "0010", "--yes", "--db", site)
    assert refused.status == 2
    assert "written by a newer stemwatch (schema 9999" in refused.said


def test_a_backup_onto_a_full_disk_names_the_file_and_leaves_none(
    stemwatch, site: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It had said only that there is no space on some device."""

    def full(_handle: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    process = stemwatch("db", "backup", tmp_path / "b.zip", "--db", site)
    assert process.status == 2
    assert "b.zip: the backup could not be written (No space left on device)" in process.said
    assert list(tmp_path.glob("b.zip*")) == []


def test_looking_makes_no_database(stemwatch, tmp_path: Path) -> None:
    """A misspelt name is an error, not an empty database."""
    url = f"sqlite:///{tmp_path / 'misspelt.db'}"
    for command in (["version"], ["check"], ["backup", tmp_path / "b.zip"],
                    ["prune", "--samples-days", 5]):  # fmt: skip
        outcome = stemwatch("db", *command, "--db", url)
        assert outcome.status == 2
        assert "there is no database at" in outcome.said
    for command in (["accounts", "list"], ["accounts", "first-link"], ["accounts", "add"],
                    ["feedback"], ["maintenance-report"], ["plan-test", "FIC-104"],
                    ["maintenance", "FIC-104", "--note", "x"]):  # fmt: skip
        outcome = stemwatch(*command, "--db", url)
        assert outcome.status == 2, command
        assert "there is no database at" in outcome.said
    assert list(tmp_path.iterdir()) == []


def test_a_database_without_valves_is_an_error(stemwatch, tmp_path: Path) -> None:
    """Of a database that nothing was screened into, nothing is counted as if it were a plant's."""
    url = f"sqlite:///{tmp_path / 'new.db'}"
    open_store(url).close()
    for command in ("feedback", "maintenance-report"):
        outcome = stemwatch(command, "--db", url)
        assert outcome.status == 2
        assert "no valve was screened into this database yet" in outcome.said


def test_check_shows_rows_and_says_that_all_is_well(stemwatch, site: str) -> None:
    """Tables with their rows, the engine, the schema."""
    outcome = stemwatch("db", "check", "--db", site)
    assert outcome.status == 0, outcome.said
    assert "SQLite" in outcome.said
    assert "samples 14400" in outcome.said
    assert "Nothing is wrong" in outcome.said


def test_check_finds_damage(stemwatch, site: str) -> None:
    """An index that has lost its entries is told in SQLite's own words, with status 1."""
    with closing(sqlite3.connect(site.removeprefix("sqlite:///"))) as connection:
        connection.execute("PRAGMA writable_schema = ON")
        connection.execute(
            "UPDATE sqlite_schema SET rootpage = "
            "(SELECT rootpage FROM sqlite_schema WHERE name = 'ix_notes_valve_at') "
            "WHERE name = 'ix_screenings_run'"
        )
        connection.commit()
    outcome = stemwatch("db", "check", "--db", site)
    assert outcome.status == 1
    assert "SQLite says:" in outcome.said


def test_check_finds_orphans(stemwatch, site: str) -> None:
    """Rows whose parent is gone are told with status 1."""
    with closing(sqlite3.connect(site.removeprefix("sqlite:///"))) as connection:
        connection.execute("DELETE FROM tags WHERE name LIKE '%OP'")  # without foreign keys
        connection.commit()
    outcome = stemwatch("db", "check", "--db", site)
    assert outcome.status == 1
    assert "samples.tag_id names 1 row of tags that is not there" in outcome.said


def test_a_backup_is_restored(stemwatch, site: str, tmp_path: Path) -> None:
    """Everything comes back; a file or a database that is there is not overwritten."""
    file, copy = tmp_path / "b.zip", f"sqlite:///{tmp_path / 'copy.db'}"
    process = stemwatch("db", "backup", file, "--db", site)
    assert process.status == 0, process.said
    assert "screenings 30" in process.said
    assert stemwatch("db", "restore", file, "--db", copy).status == 0
    with open_store(site) as first, open_store(copy) as second:
        assert first.valves() == second.valves()
        for valve in first.valves():
            assert first.screenings(valve.id) == second.screenings(valve.id)
        assert rows_in(site, "samples") == rows_in(copy, "samples") == 14400
    repeated = stemwatch("db", "restore", file, "--db", copy)
    assert repeated.status == 2
    assert "is not empty" in repeated.said
    assert "there is a file already" in stemwatch("db", "backup", file, "--db", site).said


def test_an_older_site_is_backed_up_as_it_is(stemwatch, site: str, tmp_path: Path) -> None:
    """A backup before the upgrade does not itself upgrade."""
    engine = make_engine(DatabaseUrl(site))
    downgrade(engine, "0003")
    engine.dispose()
    assert stemwatch("db", "backup", tmp_path / "b.zip", "--db", site).status == 0
    assert "schema 0003;" in stemwatch("db", "version", "--db", site).said


def test_prune_counts_first_and_removes_when_told(stemwatch, site: str) -> None:
    """Without --yes nothing goes; with it, what was counted: never a valve's latest screening."""
    days = (datetime.now(UTC) - NOW + timedelta(days=20)).days
    requested = ("db", "prune", "--db", site, "--samples-days", 1, "--results-days", days)
    counts = stemwatch(*requested)
    assert counts.status == 0, counts.said
    assert "Nothing was removed" in counts.said
    assert (rows_in(site, "samples"), rows_in(site, "screenings")) == (14400, 30)
    process = stemwatch(*requested, "--yes")
    assert process.status == 0, process.said
    for words in ("samples 14400", "screenings 20", "alerts 0"):
        assert words in counts.said
        assert words in process.said
    assert (rows_in(site, "samples"), rows_in(site, "screenings")) == (0, 10)
    assert rows_in(site, "networks") == 2
    everything = ("db", "prune", "--db", site, "--results-days", 1, "--yes")
    assert stemwatch(*everything).status == 0
    with open_store(site) as store:
        assert len(store.latest_screenings()) == 5
    assert "all rows" not in stemwatch("db", "check", "--db", site).said


def test_prune_removes_runs_that_have_nothing_left(stemwatch, site: str) -> None:
    """A run of which no screening stays goes with them, once it is that old itself."""
    with closing(sqlite3.connect(site.removeprefix("sqlite:///"))) as connection:
        connection.execute("UPDATE runs SET finished = '2026-01-01 00:00:00.000000'")
        connection.commit()
    requested = ("db", "prune", "--db", site, "--results-days", 1)
    counts, done = stemwatch(*requested), stemwatch(*requested, "--yes")
    assert "runs 5" in counts.said
    assert "runs 5" in done.said
    assert rows_in(site, "runs") == 1


def test_prune_needs_to_be_told_what(stemwatch, site: str, tmp_path: Path) -> None:
    """No age is no order; with a plant file its own retention of samples counts."""
    outcome = stemwatch("db", "prune", "--db", site)
    assert outcome.status == 2
    assert "--samples-days" in outcome.said
    file = tmp_path / "plant.toml"
    for text in ("", "[service]\nkeep_samples_days = 0.5\n"):
        file.write_text(file.read_text(encoding="utf-8") + text, encoding="utf-8")
        planned = stemwatch("db", "prune", "--plant", file)
        assert planned.status == 0, planned.said
    outcome = stemwatch("db", "prune", "--db", site, "--results-days", "1e9")
    assert outcome.status == 2
    assert "1 to 36600 days can be kept" in outcome.said


@pytest.mark.parametrize(
    "command",
    [["version"], ["check"], ["upgrade"], ["backup", "b.zip"], ["prune", "--samples-days", "9"]],
)
def test_no_password_is_shown(stemwatch, command: list[str]) -> None:
    """A server that does not answer is named without the password."""
    outcome = stemwatch("db", *command, "--db", NOWHERE)
    assert outcome.status == 2
    assert "***" in outcome.said
    assert SECRET not in outcome.out + outcome.err


def test_a_database_must_be_named(stemwatch, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without plant file, URL and variable the three ways are told."""
    monkeypatch.delenv("STEMWATCH_STORAGE_URL", raising=False)
    outcome = stemwatch("db", "check")
    assert outcome.status == 2
    assert "--plant plant.toml or --db URL, or set STEMWATCH_STORAGE_URL" in outcome.said
