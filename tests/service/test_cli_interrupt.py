"""Ctrl-C and SIGTERM end a run at once; they and SIGKILL leave a database that works."""

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

pytestmark = [
    pytest.mark.skipif(os.name == "nt", reason="signals are sent the POSIX way"),
    pytest.mark.early,
]


def _ignore_ctrl_c() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def started_runs(database: Path) -> int:
    """How many runs the database knows; 0 where it is not there or has no tables yet."""
    if not database.exists():
        return 0
    with closing(sqlite3.connect(f"file:{database}?mode=ro", uri=True)) as connection:
        try:
            return connection.execute("SELECT count(*) FROM runs").fetchone()[0]
        except sqlite3.OperationalError:
            return 0


ENDS = {
    "Ctrl-C": (signal.SIGINT, 130, "cancelled", "interrupted by Ctrl-C"),
    "SIGTERM": (signal.SIGTERM, 143, "cancelled", "ended by SIGTERM"),
    "SIGKILL": (signal.SIGKILL, -9, "failed", "its process ended before the run was over"),
}


@pytest.mark.parametrize(
    ("workers", "by"),
    [
        pytest.param(1, "Ctrl-C", marks=pytest.mark.long),
        (2, "Ctrl-C"),
        pytest.param(2, "SIGTERM", marks=pytest.mark.long),
        pytest.param(2, "SIGKILL", marks=pytest.mark.long),
    ],
)
def test_an_interrupted_run_leaves_a_usable_database(
    stemwatch, one_valve: Path, tmp_path: Path, workers: int, by: str
) -> None:
    """The process is gone without a traceback, its run is over with the reason, and the next run
    keeps its result. A script's background job ignores Ctrl-C and hears of SIGTERM alone."""
    number, status, state, reason = ENDS[by]
    folder, database = tmp_path / "exports", tmp_path / "kept.db"
    folder.mkdir()
    for index in range(96):
        os.link(one_valve, folder / f"valve{index:02}.csv")
    tags = ("--op", "FIC-104.OP", "--mv", "FIC-104.ZT", "--db", f"sqlite:///{database}")
    more = ("--workers", str(workers), "--out", str(tmp_path / "cut"))
    process = subprocess.Popen(
        [sys.executable, "-m", "stemwatch.service", "screen", str(folder), *tags, *more],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        encoding="utf-8",
        start_new_session=True,
        preexec_fn=_ignore_ctrl_c if number is not signal.SIGINT else None,
    )
    for _ in range(600):
        if started_runs(database) or process.poll() is not None:
            break
        time.sleep(0.05)
    assert process.poll() is None
    # A terminal sends it to the whole group.
    (os.killpg if number is signal.SIGINT else os.kill)(process.pid, number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == status
    assert "Traceback" not in err

    after = stemwatch("screen", one_valve, *tags, "--out", tmp_path / "out", "--workers", 1)
    assert after.status == 0, after.said
    with closing(sqlite3.connect(database)) as connection:
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        ended = connection.execute("SELECT state, finished IS NOT NULL FROM runs ORDER BY id")
        assert [(state, 1), ("done", 1)] == ended.fetchall()
        (text,) = connection.execute("SELECT reason FROM runs ORDER BY id").fetchone()
        assert text.startswith(reason)
        assert ("historian",) in connection.execute("SELECT valve FROM screenings").fetchall()
