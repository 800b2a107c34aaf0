"""``stemwatch db`` on both engines: moving a site, and the same report wherever it lives."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from stemwatch.service.store.administration import check as checking
from stemwatch.service.store.administration.backup import disposing
from stemwatch.service.store.database.engine import for_writing, make_engine
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.store import open_store
from tests.service.conftest import HEALTHY, STICKY, write_small_plant
from tests.service.store.administration.test_store_transfer import rows_of
from tests.service.store.older_databases import database_at

NewDatabase = Callable[[str], str]
pytestmark = pytest.mark.postgres
# What a report's page says of the run itself: when, how long, with which command.
CLOCK = re.compile(
    r"\d{4}-\d\d-\d\d \d\d:\d\d(?=</title>| \(Europe/Berlin\)(?:</p>|</dd>))"
    r"|(?<=stemwatch 0\.1\.0 in )[\d.e-]+ s|(?<=<dt>Command</dt><dd>)<code>.*?</code>"
    r'|(?<=<p class="printed">stemwatch 0\.1\.0 · )<code>.*?</code>'
)


def report_of(folder: Path) -> tuple[Any, str, str]:
    """What a report says, without when it was made and how long it took: JSON, CSV, page."""
    valves = without_seconds(json.loads((folder / "valves.json").read_text("utf-8")))
    page = CLOCK.sub("", (folder / "report.html").read_text("utf-8"))
    return valves, (folder / "valves.csv").read_text("utf-8"), page


def without_seconds(value: Any) -> Any:
    """The same value without any ``seconds``, at every depth, also inside JSON that is text."""
    if isinstance(value, dict):
        return {key: without_seconds(item) for key, item in value.items() if key != "seconds"}
    if isinstance(value, list):
        return [without_seconds(item) for item in value]
    if isinstance(value, str) and value.startswith("{"):
        return without_seconds(json.loads(value))
    return value


def screened(stemwatch, plant: Path, out: Path, url: str, *window: str) -> Any:
    """The report of one screening into the database ``url``."""
    outcome = stemwatch(
        "screen", "--plant", plant, "--out", out, "--db", url, "--workers", 1, *window
    )
    assert outcome.status == 0, outcome.said
    return report_of(out)


@pytest.mark.long
def test_one_site_on_two_engines_gives_one_report(
    stemwatch, tmp_path: Path, new_database: NewDatabase
) -> None:
    """A plant is screened into SQLite and into PostgreSQL, and again with what is stored by then;
    then the SQLite site is copied and goes on there. Every report is the same to the last byte."""
    lite, server, moved = (new_database(engine) for engine in ("sqlite", *["postgresql"] * 2))
    plant = write_small_plant(tmp_path / "plant", (HEALTHY, STICKY), minutes=12)
    half = ("--to", "2026-03-02T06:06:00Z")
    first = [screened(stemwatch, plant, tmp_path / "a", url, *half) for url in (lite, server)]
    assert first[0] == first[1]
    outcome = stemwatch("db", "copy", "--db", lite, "--to", moved)
    assert outcome.status == 0, outcome.said
    sites = (lite, server, moved)
    second = [screened(stemwatch, plant, tmp_path / "b", url) for url in sites]
    assert second[0] == second[1] == second[2]
    assert len(second[0][0]) == 2
    baselines = [valve["baseline"] for valve in second[0][0]]
    assert any("aseline" in baseline for baseline in baselines)
    stored = [results_of(url) for url in sites]
    assert stored[0] == stored[1] == stored[2]


def results_of(url: str) -> dict[str, list[dict[str, object]]]:
    """Screenings and indicators in a database, without times of day and durations."""
    result = rows_of(url)
    return {name: without_seconds(result[name]) for name in ("valves", "screenings", "indicators")}


def test_a_report_is_compared_with_its_numbers() -> None:
    """What the comparison leaves out is only how long something took."""
    answer = [
        {"valve": "A", "seconds": 1, "in": {"seconds": 2, "S": 3.1}, "text": '{"seconds": 1}'}
    ]
    assert without_seconds(answer) == [{"valve": "A", "in": {"S": 3.1}, "text": {}}]


def test_copy_says_what_came_and_no_password(
    stemwatch, new_database: NewDatabase, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rows of each table are shown; the password of neither URL is."""
    lite, server = new_database("sqlite"), new_database("postgresql")
    with database_at(lite, "0013"):
        pass
    monkeypatch.setenv("STEMWATCH_STORAGE_URL", lite)
    monkeypatch.setenv("STEMWATCH_COPY_TO", server)
    outcome = stemwatch("db", "copy")
    assert outcome.status == 0, outcome.said
    assert "screenings 2" in outcome.said
    assert "geheim" not in outcome.said
    repeated = stemwatch("db", "copy")
    assert repeated.status == 2
    assert "is not empty" in repeated.said
    assert "geheim" not in repeated.said


def test_a_backup_crosses_over(stemwatch, new_database: NewDatabase, tmp_path: Path) -> None:
    """A site in PostgreSQL is backed up and restored into a file, with the same rows."""
    server, lite, file = new_database("postgresql"), new_database("sqlite"), tmp_path / "b.zip"
    with database_at(server, "0013"):
        pass
    assert stemwatch("db", "backup", file, "--db", server).status == 0
    assert stemwatch("db", "restore", file, "--db", lite).status == 0
    assert rows_of(server) == rows_of(lite)


def test_check_tells_a_sound_database_from_a_broken_one(
    stemwatch, new_database: NewDatabase
) -> None:
    """Orphans, numbers that are taken, and missing views are problems, each with what to do."""
    url = new_database("postgresql")
    with database_at(url, "0013"):
        pass
    sound = stemwatch("db", "check", "--db", url)
    assert sound.status == 0, sound.said
    assert "PostgreSQL" in sound.said
    assert "Nothing is wrong" in sound.said
    with (
        disposing(make_engine(DatabaseUrl(url))) as engine,
        for_writing(engine).begin() as connection,
    ):
        connection.execute(text("INSERT INTO samples VALUES (77, 5, 1.0, 0, NULL)"))
        connection.execute(text("SELECT setval('runs_id_seq', 1)"))
        connection.execute(text("DROP VIEW stemwatch_samples_v1"))
    broken = stemwatch("db", "check", "--db", url)
    assert broken.status == 1
    assert "samples.tag_id names 1 row of tags that is not there" in broken.said
    assert "runs: the next number, after 1, is taken (up to 2)" in broken.said
    assert "views are missing: stemwatch_samples_v1" in broken.said


def test_check_speaks_of_partitions(new_database: NewDatabase) -> None:
    """How many days there are, strays, and a day that is not made yet."""
    url = new_database("postgresql")
    with database_at(url, "0013", rows=False), open_store(url) as store:
        store.samples.prepare_days()
    now = datetime.now(UTC)
    health = checking.check(DatabaseUrl(url), now)
    assert "8 partitions by day" in health.notes[0]
    assert health.problems == ()
    late = checking.check(DatabaseUrl(url), now + timedelta(days=30))
    assert any("tomorrow has no partition yet" in note for note in late.notes)
    assert {table.size_bytes is not None for table in late.tables} == {True}
