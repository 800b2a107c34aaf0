"""``stemwatch judge-test``: the plan is made, played on a concealed valve, exported, and judged."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from typer.testing import CliRunner

from stemwatch.models.field_test.plan import plan_test
from stemwatch.models.field_test.programme import TestLimits
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.service.cli import app
from stemwatch.service.store.store import open_store
from tests.models.field_test.simulated_test import BEGAN, simulated_test
from tests.service.example_mismatches import of_every_kind
from tests.service.field_test.planned_tests import QUESTION

MINUTES = 5.0


def run(*arguments: str):
    """A command of the front door, in a wide terminal."""
    return CliRunner().invoke(app, [*arguments], env={"COLUMNS": "250"})


def exported(recording: Recording, path) -> str:
    """The recording as a plant exports it, with ten minutes of rest before."""
    rest = 600
    with path.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow(["time", "FIC1.OP", "FIC1.MV"])
        op, mv = recording.op.values, recording.mv.values
        for k in range(-rest, len(recording)):
            at = recording.start + timedelta(seconds=k)
            row = max(k, 0)
            out.writerow([at.isoformat(), f"{op[row]:.3f}", f"{mv[row]:.3f}"])
    return str(path)


def saved(store, screening, window: datetime) -> None:
    """One run with one screening whose window ended at ``window``."""
    recording = replace(screening.recording, start=window - timedelta(seconds=399))
    number = store.begin_run(software_version="test")
    store.save(replace(screening, recording=recording), number)
    store.finish_run(number)


@pytest.fixture(scope="module")
def database(tmp_path_factory):
    """A valve that left lag and dead time open before the test, and nothing after it."""
    address = f"sqlite:///{tmp_path_factory.mktemp('judged') / 'store.db'}"
    still = Recording(
        valve="FIC-1",
        signals={
            Role.OP: Signal.good(np.full(400, 42.0), "OP"),
            Role.MV: Signal.good(np.full(400, 41.5), "MV"),
        },
        interval_s=1.0,
        start=datetime(2026, 3, 2, 6, tzinfo=UTC),
    )
    (bare,) = screen([Case(recording=still)], Options(narx=False))
    mismatch = next(item for item in of_every_kind(still) if item.finding is Finding.CANDIDATES)
    changed = replace(bare, mismatch=replace(mismatch, open_question=QUESTION))
    two = replace(bare, mismatch=replace(mismatch, open_question=replace(QUESTION, models=())))
    with open_store(address) as store:
        saved(store, changed, BEGAN - timedelta(hours=1))
        saved(store, two, BEGAN + timedelta(hours=1))
        saved(store, replace(two, valve="FIC-2"), BEGAN - timedelta(hours=1))
    return address


@pytest.fixture(scope="module")
def programme():
    """The test that was planned for it."""
    return plan_test(QUESTION, TestLimits(duration_s=60.0 * MINUTES)).test.programme


@pytest.mark.parametrize(
    ("hidden", "slug", "name"),
    [
        pytest.param({"lag_s": 4.0}, "actuator_lag", "actuator lag", marks=pytest.mark.long),
        ({"dead_time_s": 4.0}, "dead_time", "dead time"),
    ],
)
def test_plan_played_on_a_concealed_valve_names_what_it_hides(
    database, programme, tmp_path, hidden, slug, name
):
    """Text, JSON and page agree on the winner; the rivals are those from before the test."""
    test = exported(simulated_test(programme, 47.0, **hidden), tmp_path / "test.csv")
    file, folder = tmp_path / "result.json", tmp_path / "out"
    process = run(
        *("judge-test", "FIC-1", test, "--db", database, "--from", BEGAN.isoformat()),
        *("--op", "FIC1.OP", "--mv", "FIC1.MV", "--json", str(file), "--out", str(folder)),
    )
    assert process.exit_code == 0, process.output
    assert f"FIC-1: the test says {name}" in process.output
    assert "rivals of the screening that ended 2026-03-02 08:00 UTC" in process.output
    loaded = json.loads(file.read_text(encoding="utf-8"))
    assert (loaded["outcome"], loaded["winner"], loaded["left"]) == ("follows", slug, [slug])
    assert loaded["start"] == BEGAN.isoformat()
    page = (folder / "test-result.html").read_text(encoding="utf-8")
    assert loaded["headline"] in page
    assert "MV recorded" in page
    assert "<script" not in page


def test_file_that_asked_for_a_bump_test_is_sent_to_screen(tmp_path, programme):
    """A first recording without movement has no rivals: the verdict is what its test gives."""
    still = simulated_test(programme, 47.0)
    values = {role: Signal.good(np.full(400, 47.0), role.value) for role in (Role.OP, Role.MV)}
    before = exported(replace(still, signals=values), tmp_path / "before.csv")
    test = exported(still, tmp_path / "test.csv")
    process = run("judge-test", before, test, "--op", "FIC1.OP", "--mv", "FIC1.MV")
    assert process.exit_code != 0
    assert "`stemwatch screen` (the verdict, after a bump test)" in str(process.exception)


def test_what_cannot_be_judged_is_said_with_what_to_do(database, programme, tmp_path):
    """Without a recording, without a question, with a recording in which nothing moves."""
    tags = ("--op", "FIC1.OP", "--mv", "FIC1.MV")
    missing = run("judge-test", "FIC-1", "--db", database)
    assert missing.exit_code == 2
    assert "--plant with --from and --to" in missing.output
    test = exported(simulated_test(programme, 47.0), tmp_path / "test.csv")
    nothing = run("judge-test", "FIC-2", test, "--db", database, *tags)
    assert nothing.exit_code != 0
    assert "no effects were left to be told apart" in str(nothing.exception)
    unknown = run("judge-test", "FIC-9", test, "--db", database, *tags)
    assert unknown.exit_code == 2
    assert "FIC-1" in unknown.output
    before = BEGAN - timedelta(minutes=9)
    window = ("--from", before.isoformat(), "--to", BEGAN.isoformat())
    still = run("judge-test", "FIC-1", test, "--db", database, *tags, *window)
    assert still.exit_code == 0, still.output
    assert "is this the recording of the test?" in " ".join(still.output.split())


def test_test_of_a_plant_is_read_where_the_plant_keeps_it(database, programme, tmp_path):
    """With the plant file and the window no export is needed."""
    exported(simulated_test(programme, 47.0, dead_time_s=4.0), tmp_path / "samples.csv")
    plant = tmp_path / "plant.toml"
    plant.write_text(
        f"""[storage]
url = "{database}"

[[sources]]
name = "export"
path = "samples.csv"

[[valves]]
id = "FIC-1"
source = "export"

[valves.tags.op]
tag = "FIC1.OP"

[valves.tags.mv]
tag = "FIC1.MV"
""",
        encoding="utf-8",
    )
    end = BEGAN + timedelta(seconds=programme.duration_s)
    window = ("--from", BEGAN.isoformat(), "--to", end.isoformat())
    process = run("judge-test", "FIC-1", "--plant", str(plant), *window)
    assert process.exit_code == 0, process.output
    assert "the test says dead time" in process.output
