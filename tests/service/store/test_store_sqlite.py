"""What is particular to SQLite files, and to stores that cannot be opened."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import text
from sqlalchemy.dialects import sqlite

from stemwatch.models.screening_result import Screening
from stemwatch.service.store.database.columns import UtcDateTime
from stemwatch.service.store.database.engine import BUSY_TIMEOUT_MS, make_engine
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.store import open_store


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"sqlite:///{tmp_path / 'store.db'}"


@pytest.mark.parametrize(
    ("pragma", "expected"),
    [("journal_mode", "wal"), ("foreign_keys", 1), ("busy_timeout", BUSY_TIMEOUT_MS)],
)
def test_every_connection_is_prepared(url: str, pragma: str, expected: object) -> None:
    """Readers do not wait for the writer, references hold, and writers wait for one another."""
    open_store(url).close()
    engine = make_engine(DatabaseUrl(url))
    with engine.connect() as connection:
        assert expected == connection.execute(text(f"PRAGMA {pragma}")).scalar()
    engine.dispose()


def test_a_naive_datetime_is_refused_by_the_column() -> None:
    """The column type itself refuses, so that no table can be written around it."""
    with pytest.raises(ValueError, match="timezone aware datetime is expected, received 2026"):
        UtcDateTime().process_bind_param(datetime(2026, 1, 1), sqlite.dialect())


def test_a_failed_save_leaves_the_screening_before_it(
    url: str, make_screening: Callable[..., Screening]
) -> None:
    """A save is all or nothing: when the indicators fail, the row keeps its old values."""
    with open_store(url) as store:
        run = store.begin_run(software_version="1")
        store.save(make_screening(severity=1.0), run)
        with sqlite3.connect(url.removeprefix("sqlite:///")) as raw:
            raw.execute(
                "CREATE TRIGGER full BEFORE INSERT ON indicators "
                "BEGIN SELECT RAISE(ABORT, 'disk full'); END"
            )
        raw.close()
        with pytest.raises(StoreError, match=r"store\.db: saving FIC-101 failed: disk full"):
            store.save(make_screening(severity=2.0), run)
        (kept,) = store.screenings("FIC-101")
        assert 1.0 == kept.severity
        assert 42.0 == store.indicators(kept.id)["reversals"].value


def test_when_the_database_is_gone_the_rest_is_not_tried(
    url: str, make_screening: Callable[..., Screening]
) -> None:
    """Three saves without an answer are enough; five thousand would each wait their time."""
    with open_store(url) as store:
        run = store.begin_run(software_version="1")
        with sqlite3.connect(url.removeprefix("sqlite:///")) as raw:
            raw.execute("DROP TABLE indicators")
        raw.close()
        report = store.save_many([make_screening(valve=f"V{n}") for n in range(6)], run)
    assert 0 == report.saved
    reasons = [failure.reason for failure in report.failures]
    assert ["no such table: indicators"] * 3 == reasons[:3]
    assert ["not tried: no answer"] * 3 == [reason[:20] for reason in reasons[3:]]


def test_a_file_that_is_no_database_is_named(tmp_path: Path) -> None:
    """Opening something else says which file and what it is not."""
    path = tmp_path / "plant.toml"
    path.write_text("[plant]\n" * 200)
    with pytest.raises(StoreError, match=r"plant\.toml: opening the store failed: file is not a"):
        open_store(f"sqlite:///{path}")
    assert path.read_text() == "[plant]\n" * 200


@pytest.mark.skipif(os.name == "nt", reason="rights of files are POSIX")
def test_a_database_file_is_its_owners_alone(url: str) -> None:
    """It holds digests of passwords; the files beside it take the same rights."""
    before = os.umask(0o022)
    try:
        with open_store(url) as store:
            store.begin_run(software_version="1")
            files = list(Path(url.removeprefix("sqlite:///")).parent.glob("store.db*"))
            assert len(files) == 3
            assert {path.stat().st_mode & 0o777 for path in files} == {0o600}
    finally:
        os.umask(before)


@pytest.mark.parametrize("seed", range(4))
def test_a_damaged_file_is_called_damaged(
    url: str, make_screening: Callable[..., Screening], seed: int
) -> None:
    """Bytes overwritten anywhere: whatever is asked, an answer or a StoreError that says what to
    do, and never an error of a codec."""
    with open_store(url) as store:
        run = store.begin_run(software_version="1")
        store.save_many([make_screening(valve=f"V{n}") for n in range(40)], run)
        store.finish_run(run)
    path = Path(url.removeprefix("sqlite:///"))
    content = bytearray(path.read_bytes())
    rng = np.random.default_rng(seed)
    for _ in range(60):
        at = int(rng.integers(0 if seed == 0 else 4096, len(content) - 256))
        content[at : at + 256] = rng.integers(0, 256, 256, dtype=np.uint8).tobytes()
    path.write_bytes(content)
    sentences = []
    for ask in (
        lambda store: store.latest_screenings(),
        lambda store: store.valves(),
        lambda store: store.run(run),
        lambda store: store.queue.recent(),
        lambda store: store.screenings("V3"),
        lambda store: store.save(make_screening(valve="V7"), run),
        lambda store: store.add_note("V3", datetime.now(UTC), "a"),
    ):
        try:
            with open_store(url) as store:
                ask(store)
        except StoreError as error:
            sentences.append(str(error))
    assert sentences
    assert all("stemwatch db restore" in item for item in sentences), sentences


def test_a_text_that_is_no_text_any_more_is_damage(url: str) -> None:
    """A byte of a note in another encoding is said as damage, with the remedy."""
    with open_store(url) as store:
        store.add_note("FIC-101", datetime.now(UTC), "packing seen to")
        with sqlite3.connect(url.removeprefix("sqlite:///")) as raw:
            raw.execute("UPDATE notes SET note = CAST(x'7b22f72233' AS TEXT)")
        raw.close()
        with pytest.raises(StoreError, match=r"damaged.*stemwatch db restore"):
            store.notes("FIC-101")


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    """A path into nowhere is an error with the path, not a new folder."""
    with pytest.raises(StoreError, match=r"none/store\.db: opening the store failed: unable to"):
        open_store(f"sqlite:///{tmp_path / 'none' / 'store.db'}")


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("not a url", "not a database URL; expected sqlite:///file.db or postgresql://"),
        ("postgresql+pg8000://u:geheim@h/d", r"no driver for this database \(.*pg8000"),
        ("mssql://u:geheim@h/d", "needs SQLite or PostgreSQL, received mssql"),
    ],
)
def test_an_address_that_is_none_is_explained(url: str, message: str) -> None:
    """A wrong URL, another engine or a missing driver is said in words, passwords masked."""
    with pytest.raises(StoreError, match=message) as caught:
        open_store(url)
    assert "geheim" not in str(caught.value)
