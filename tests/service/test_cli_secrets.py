"""A database password is needed once and shown never."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from stemwatch.service.executors import InProcess
from stemwatch.service.run.engine import RunNow, screen_now
from stemwatch.service.run.plan import Request
from stemwatch.service.store.store import open_store

SECRET = "s3cr3t-pa55"
NOWHERE = f"postgresql://anna:{SECRET}@127.0.0.1:1/stemwatch"  # nothing listens on port 1


def test_a_password_of_the_command_line_is_never_printed(
    stemwatch_process, one_valve: Path, tmp_path: Path
) -> None:
    """The run ends with 2, names the database, and the password is nowhere in what it prints."""
    outcome = stemwatch_process("screen", one_valve, "--db", NOWHERE, cwd=tmp_path)
    assert outcome.status == 2
    assert "127.0.0.1" in outcome.said
    assert "***" in outcome.said
    assert SECRET not in outcome.out + outcome.err
    assert "Traceback" not in outcome.err


def test_a_password_of_the_plant_file_is_never_printed(
    stemwatch, plant: Path, tmp_path: Path
) -> None:
    """The same for a URL that stands in plant.toml."""
    storage = f'[storage]\nurl = "{NOWHERE}"\n\n'
    plant.write_text(storage + plant.read_text(encoding="utf-8"), encoding="utf-8")
    outcome = stemwatch("screen", "--plant", plant, "--out", tmp_path / "out")
    assert outcome.status == 2
    assert SECRET not in outcome.out + outcome.err


def test_a_password_of_the_environment_is_never_printed(
    stemwatch, plant: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same for a URL that the environment gives, which comes before the plant file's."""
    monkeypatch.setenv("STEMWATCH_STORAGE_URL", NOWHERE)
    outcome = stemwatch("screen", "--plant", plant, "--out", tmp_path / "out")
    assert outcome.status == 2
    assert SECRET not in outcome.out + outcome.err


def test_what_is_kept_holds_no_password(one_valve: Path, tmp_path: Path) -> None:
    """No file of the report and nothing in the database holds the password of the command line."""
    with open_store(f"sqlite:///{tmp_path / 'kept.db'}") as store:
        how = RunNow(
            store=store,
            executor=InProcess(),
            out=tmp_path / "out",
            command=("stemwatch", "screen", str(one_valve), "--db", NOWHERE),
        )
        result = screen_now(Request(sources=(str(one_valve),)), how)
    with zipfile.ZipFile(result.report.xlsx) as sheets:
        table = b"".join(sheets.read(name) for name in sheets.namelist())
    assert b"postgresql://anna:***@" in table
    written = [path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()]
    assert len(written) >= 5
    assert [] == [content for content in (table, *written) if SECRET.encode() in content]
