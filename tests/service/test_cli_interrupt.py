"""Ctrl-C ends a run at once and leaves a database that works."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way")


def started_runs(database: Path) -> int:
    """How many runs the database knows; 0 where it is not there or has no tables yet."""
    if not database.exists():
        return 0
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as connection:
        try:
            return connection.execute("SELECT count(*) FROM runs").fetchone()[0]
        except sqlite3.OperationalError:
            return 0


@pytest.mark.parametrize("workers", [1, 2])
def test_an_interrupted_run_leaves_a_usable_database(
    stemwatch, one_valve: Path, tmp_path: Path, workers: int
) -> None:
    """After Ctrl-C the process is gone without a traceback, its run is noted as cancelled, and the
    next run keeps its result."""
    folder, database = tmp_path / "exports", tmp_path / "kept.db"
    folder.mkdir()
    for place in range(96):
        os.link(one_valve, folder / f"valve{place:02}.csv")
    tags = ("--op", "FIC-104.OP", "--mv", "FIC-104.ZT", "--db", f"sqlite:///{database}")
    more = ("--workers", str(workers), "--out", str(tmp_path / "cut"))
    process = subprocess.Popen(
        [sys.executable, "-m", "stemwatch.service", "screen", str(folder), *tags, *more],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        start_new_session=True,
    )
    for _ in range(600):
        if started_runs(database) or process.poll() is not None:
            break
        time.sleep(0.05)
    assert process.poll() is None
    os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to the whole group
    _, err = process.communicate(timeout=60)
    assert process.returncode != 0
    assert "Traceback" not in err

    after = stemwatch("screen", one_valve, *tags, "--out", tmp_path / "out", "--workers", 1)
    assert after.status == 0, after.said
    with closing(sqlite3.connect(database)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        ended = connection.execute("SELECT state, finished IS NOT NULL FROM runs ORDER BY id")
        assert [("cancelled", 1), ("done", 1)] == ended.fetchall()
        assert ("historian",) in connection.execute("SELECT valve FROM screenings").fetchall()
