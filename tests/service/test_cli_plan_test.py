"""``stemwatch plan-test``: from a file and from the store, its limits, and what it refuses."""

from __future__ import annotations

import csv
import errno
import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.service.cli import app
from stemwatch.service.store.store import open_store
from tests.service.example_mismatches import of_every_kind
from tests.service.field_test.planned_tests import QUESTION

QUICK = ("--minutes", "2")


def run(*arguments: str):
    """The command with these arguments, in a wide terminal."""
    return CliRunner().invoke(app, ["plan-test", *arguments], env={"COLUMNS": "250"})


@pytest.fixture
def still(tmp_path):
    """An export whose OP never moves."""
    path = tmp_path / "still.csv"
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["time", "FIC1.OP", "FIC1.MV"])
        for k in range(300):
            at = f"2026-03-02T06:{k // 60:02d}:{k % 60:02d}Z"
            out.writerow([at, "42.0", f"{41.5 + 0.05 * ((k * 7) % 5):.2f}"])
    return path


@pytest.fixture(scope="module")
def database(tmp_path_factory):
    """A store with a valve whose last screening leaves lag and dead time open, and a still one."""
    address = f"sqlite:///{tmp_path_factory.mktemp('plans') / 'store.db'}"
    rng = np.random.default_rng(3)
    still = Recording(
        valve="FIC-2",
        signals={
            Role.OP: Signal.good(np.full(400, 42.0), "OP"),
            Role.MV: Signal.good(41.5 + rng.normal(0.0, 0.05, 400), "MV"),
        },
        interval_s=1.0,
        start=datetime(2026, 3, 2, 6, tzinfo=UTC),
    )
    (bare,) = screen([Case(recording=still)], Options(narx=False))
    mismatch = next(item for item in of_every_kind(still) if item.finding is Finding.CANDIDATES)
    open_one = replace(
        bare,
        valve="FIC-1",
        recording=replace(still, valve="FIC-1"),
        mismatch=replace(mismatch, open_question=QUESTION),
    )
    with open_store(address) as store:
        number = store.begin_run(software_version="test")
        for screening in (open_one, bare):
            store.save(screening, number)
        store.finish_run(number)
    return address


def test_store_is_enough_to_plan_the_test_and_the_sheet_is_written(database, tmp_path):
    """The last screening holds all that a plan needs; text, JSON and files agree."""
    file = tmp_path / "plan.json"
    process = run(
        "FIC-1", "--db", database, *QUICK, "--json", str(file), "--out", str(tmp_path / "o")
    )
    assert process.exit_code == 0, process.output
    assert "tells actuator lag and dead time apart" in process.output
    assert "stemwatch never writes to a plant" in process.output
    loaded = json.loads(file.read_text(encoding="utf-8"))
    assert loaded["kind"] == "tells"
    assert loaded["rivals"] == ["actuator_lag", "dead_time"]
    assert loaded["values"][-1]["at_s"] < 120.0
    assert {path.name for path in (tmp_path / "o").iterdir()} == {"test-plan.html", "test-plan.pdf"}


def test_a_file_that_cannot_be_written_whole_stays_as_it_was(database, tmp_path, monkeypatch):
    """On a full disk the plan of before is kept, the file is named, and what to do is said."""
    file = tmp_path / "plan.json"
    file.write_text("the plan of before")
    opened = Path.open

    def full(path, *arguments, **options):
        if path.suffix == ".part":
            raise OSError(errno.ENOSPC, "No space left on device")
        return opened(path, *arguments, **options)

    monkeypatch.setattr(Path, "open", full)
    process = run("FIC-2", "--db", database, *QUICK, "--json", str(file))
    assert process.exit_code != 0
    expected = "plan.json: could not be written (No space left on device); make room on its disk"
    assert expected in str(process.exception)
    monkeypatch.undo()
    assert [path.read_text() for path in tmp_path.iterdir()] == ["the plan of before"]


def test_the_plan_may_go_to_a_pipe(database):
    """What is no file is written to as it is, and not replaced."""
    process = run("FIC-2", "--db", database, *QUICK, "--json", "/dev/null")
    assert process.exit_code == 0, process.output
    assert Path("/dev/null").is_char_device()


def test_limits_are_kept_and_those_without_sense_refused(database, tmp_path):
    """OP now and its limits hold; an amplitude of nothing is wrong usage."""
    file = tmp_path / "plan.json"
    limits = ("--amplitude", "3", "--op-now", "60", "--op-high", "61", "--json", str(file))
    assert run("FIC-1", "--db", database, *QUICK, *limits).exit_code == 0
    values = [value["op_percent"] for value in json.loads(file.read_text())["values"]]
    assert max(values) <= 61.0
    assert min(values) >= 57.0
    refused = run("FIC-1", "--db", database, "--amplitude", "0")
    assert refused.exit_code != 0
    assert "amplitude" in str(refused.exception)


def test_valve_without_a_verdict_gets_the_bump_test_from_store_and_file(database, still):
    """No movement, no verdict: the test that would give one."""
    stored = run("FIC-2", "--db", database, *QUICK)
    assert "bump test" in stored.output
    assert "OP was last at 42.0 %" in stored.output
    read = run(str(still), *QUICK, "--op", "FIC1.OP", "--mv", "FIC1.MV")
    assert read.exit_code == 0, read.output
    assert "bump test" in read.output
    assert "OP was last at 42.0 %" in read.output


def test_a_file_is_read_with_the_options_of_every_command_that_reads(still, tmp_path):
    """Decimal commas, semicolons and a name are what they are for ``explain``."""
    german = tmp_path / "german.csv"
    german.write_text(still.read_text().replace(",", ";").replace(".", ","))
    options = ("--separator", ";", "--decimal", ",", "--valve", "FIC-7")
    read = run(str(german), *QUICK, "--op", "FIC1,OP", "--mv", "FIC1,MV", *options)
    assert read.exit_code == 0, read.output
    assert "FIC-7" in read.output
    assert "bump test" in read.output


def test_what_is_neither_file_nor_valve_is_said_with_what_there_is(database):
    """A wrong name teaches."""
    neither = run("FIC-9")
    assert neither.exit_code == 2
    assert "--db URL" in neither.output
    unknown = run("FIC-9", "--db", database)
    assert unknown.exit_code == 2
    assert "FIC-1" in unknown.output
