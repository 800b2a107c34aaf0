"""A database password is needed once and shown never."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

SECRET = "s3cr3t-pa55"
NOWHERE = f"postgresql://anna:{SECRET}@127.0.0.1:1/stemwatch"  # nothing listens on port 1


def test_an_unreachable_database_on_the_command_line(
    stemwatch_process, one_valve: Path, tmp_path: Path
) -> None:
    """The run ends with 2, names the database, and the password is nowhere in what it prints."""
    outcome = stemwatch_process("screen", one_valve, "--db", NOWHERE, cwd=tmp_path)
    assert outcome.status == 2
    assert "127.0.0.1" in outcome.said
    assert "***" in outcome.said
    assert SECRET not in outcome.out + outcome.err
    assert "Traceback" not in outcome.err


def test_an_unreachable_database_in_the_plant_file(stemwatch, plant: Path, tmp_path: Path) -> None:
    """The same for a URL that stands in plant.toml."""
    storage = f'[storage]\nurl = "{NOWHERE}"\n\n'
    plant.write_text(storage + plant.read_text(encoding="utf-8"), encoding="utf-8")
    outcome = stemwatch("screen", "--plant", plant, "--out", tmp_path / "out")
    assert outcome.status == 2
    assert SECRET not in outcome.out + outcome.err


def test_an_unreachable_database_in_the_environment(
    stemwatch, plant: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same for a URL that the environment gives, which comes before the plant file's."""
    monkeypatch.setenv("STEMWATCH_STORAGE_URL", NOWHERE)
    outcome = stemwatch("screen", "--plant", plant, "--out", tmp_path / "out")
    assert outcome.status == 2
    assert SECRET not in outcome.out + outcome.err


def test_the_command_that_is_kept_holds_no_password(
    stemwatch, one_valve: Path, tmp_path: Path
) -> None:
    """Report and database keep the command line of a run with any password in it masked."""
    database = tmp_path / "kept.db"
    outcome = stemwatch(
        "screen", one_valve, "--op", "FIC-104.OP", "--mv", "FIC-104.ZT", "--workers", 1,
        "--db", f"sqlite:///{database}", "--valve", NOWHERE, "--out", tmp_path / "out",
    )  # fmt: skip
    assert outcome.status == 0, outcome.said
    with sqlite3.connect(database) as connection:
        ((command,),) = connection.execute("SELECT command FROM runs").fetchall()
    connection.close()
    assert "stemwatch screen" in command
    assert SECRET not in command
    # The valve's name itself may be shown; the command line beside it may not give it away.
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "postgresql://anna:***@" in report
