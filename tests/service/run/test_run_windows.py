"""The same window again, a later window, maintenance: what the store and the report then say."""

from __future__ import annotations

import csv
import json
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from tests.service.conftest import BLIND, STICKY, plant_with_database, write_small_plant

EARLY = ("--to", "2026-03-02T06:15Z")
LATE = ("--from", "2026-03-02T06:15Z")


@pytest.fixture(scope="module")
def half_hour(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """plant.toml of the sticking and the unmeasured valve: both windows, half an hour."""
    return write_small_plant(tmp_path_factory.mktemp("half_hour"), (STICKY, BLIND), minutes=30)


@pytest.fixture
def plant(half_hour: Path, tmp_path: Path) -> Path:
    """A plant file of its own, with a database of its own, that names the shared export."""
    return plant_with_database(half_hour, tmp_path)


@pytest.fixture(scope="module")
def first_run(stemwatch, half_hour: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with plant file, database and results after a run over the first window."""
    folder = tmp_path_factory.mktemp("first_run")
    plant = plant_with_database(half_hour, folder)
    out = folder / "out"
    outcome = stemwatch("screen", "--plant", plant, *EARLY, "--out", out, "--workers", 1)
    assert outcome.status == 0, outcome.said
    return folder


@pytest.fixture
def first(first_run: Path, plant: Path) -> dict[str, Any]:
    """The sticking valve's object of the first window, which was screened in this test's plant."""
    shutil.copytree(first_run, plant.parent, dirs_exist_ok=True)
    return sticking_of(plant.parent / "out")


@pytest.fixture
def screened(stemwatch, plant: Path, tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Screens the small plant, or a window of it; gives the sticking valve's object."""

    def screen(*arguments: object) -> dict[str, Any]:
        out = tmp_path / "out"
        outcome = stemwatch("screen", "--plant", plant, *arguments, "--out", out, "--workers", 1)
        assert outcome.status == 0, outcome.said
        return sticking_of(out)

    return screen


@pytest.fixture
def rows(plant: Path) -> Callable[..., list[tuple[Any, ...]]]:
    """What a query finds in the plant's database."""

    def query(sql: str, *values: object) -> list[tuple[Any, ...]]:
        with closing(sqlite3.connect(plant.parent / "stemwatch.db")) as connection:
            return connection.execute(sql, values).fetchall()

    return query


def sticking_of(out: Path) -> dict[str, Any]:
    """The sticking valve's object of the results in ``out``."""
    valves = json.loads((out / "valves.json").read_text(encoding="utf-8"))
    return next(valve for valve in valves if valve["valve"] == STICKY)


def trend_of(valve: str, out: Path) -> str:
    """What the report's table says of the change since the run before."""
    with (out / "valves.csv").open(encoding="utf-8-sig", newline="") as table:
        return next(row["trend"] for row in csv.DictReader(table) if row["valve"] == valve)


def test_the_same_window_twice_is_one_row(first, screened, rows) -> None:
    """Screening a window again updates its row; both runs stay on record."""
    second = screened(*EARLY)
    assert first["stiction"] == second["stiction"]
    counts = rows("SELECT valve, count(*), max(run_id) FROM screenings GROUP BY valve")
    assert sorted(counts) == [("FIC-104", 1, 2), ("FIC-113", 1, 2)]
    assert [(2,)] == rows("SELECT count(*) FROM runs WHERE finished IS NOT NULL")
    assert [(1,)] == rows(
        "SELECT max(n) FROM (SELECT count(*) AS n FROM indicators GROUP BY valve, name)"
    )


def test_a_later_window_has_a_trend_and_a_baseline_ratio(
    first, screened, rows, tmp_path: Path
) -> None:
    """The second window of the same export is a new row, compared with what was found before."""
    assert "baseline_ratio" not in first["indicators"]
    assert "baseline" in first["baseline"].lower()
    assert "first" in trend_of(STICKY, tmp_path / "out")

    second = screened(*LATE)
    assert [(2,)] == rows("SELECT count(*) FROM screenings WHERE valve = ?", STICKY)
    assert 0.5 < second["indicators"]["baseline_ratio"]["value"] < 2.0
    assert second["residuals"]["baseline"]["rmse"] > 0
    assert (
        "first window with a fit (sticky), 2026-03-02 06:00 to 2026-03-02 06:15"
        in (second["baseline"])
    )
    assert "first" not in trend_of(STICKY, tmp_path / "out")


@pytest.mark.long
def test_the_same_window_again_is_no_change(first, screened, tmp_path: Path) -> None:
    """A window is not compared with itself: screened again, it still has no run before it."""
    before = trend_of(STICKY, tmp_path / "out")
    screened(*EARLY)
    assert before == trend_of(STICKY, tmp_path / "out")


def test_a_window_is_not_compared_with_itself(first, screened) -> None:
    """The window that the baseline comes from is said to be the baseline, and gets no ratio."""
    repeated = screened(*EARLY)
    assert repeated["baseline"] == "This window is the baseline."
    assert repeated["residuals"]["baseline"] is None


def test_a_valve_keeps_its_first_baseline(first, screened, rows) -> None:
    """A second window does not replace the baseline, but the network fitted last is its own."""
    screened(*LATE)
    kept = rows(
        "SELECT kind, window_start, active FROM networks WHERE valve = ? ORDER BY kind", STICKY
    )
    assert [("baseline", 1), ("fitted", 1)] == [(kind, active) for kind, _, active in kept]
    assert "06:00" in kept[0][1]
    assert "06:15" in kept[1][1]


def test_maintenance_gives_a_new_baseline(stemwatch, first, screened, rows, plant: Path) -> None:
    """After work on a valve, the old baseline is said to be outdated and the next window's set,
    which is not compared with it: a repaired stem moves differently, as it should."""
    noted = stemwatch(
        "maintenance", STICKY, "--note", "packing renewed", "--plant", plant,
        "--at", "2026-03-02T07:15", "--who", "Anna",
    )  # fmt: skip
    assert noted.status == 0
    assert "2026-03-02T07:15+01:00: packing renewed" in noted.said

    second = screened(*LATE)
    assert "it describes the valve before maintenance (packing renewed" in second["baseline"]
    assert second["baseline"].endswith("begins after that and is not compared with it.")
    assert second["residuals"]["baseline"] is None
    assert "baseline_ratio" not in second["indicators"]
    (active,) = rows(
        "SELECT reason, window_start FROM networks "
        "WHERE valve = ? AND kind = 'baseline' AND active",
        STICKY,
    )
    assert active[0] == "first window after maintenance (sticky)"
    assert "06:15" in active[1]
    repeated = screened(*LATE)
    assert "before maintenance" not in repeated["baseline"]


def test_a_window_before_the_maintenance_is_no_new_baseline(
    stemwatch, first, screened, rows, plant: Path
) -> None:
    """Only a window that begins after the work shows the valve as it is now."""
    stemwatch(
        "maintenance", STICKY, "--note", "seat lapped", "--plant", plant,
        "--at", "2026-03-02T06:20Z",
    )  # fmt: skip
    screened(*LATE)
    reasons = rows("SELECT reason FROM networks WHERE valve = ? AND kind = 'baseline'", STICKY)
    assert [("first window with a fit (sticky)",)] == reasons


def test_the_user_may_choose_the_baseline(first, screened, rows) -> None:
    """--new-baseline makes this window the baseline, and the one before stays on record."""
    screened(*LATE, "--new-baseline")
    kept = rows(
        "SELECT reason, active FROM networks WHERE valve = ? AND kind = 'baseline' ORDER BY id",
        STICKY,
    )
    assert kept == [
        ("first window with a fit (sticky)", 0),
        ("window chosen by the user (sticky)", 1),
    ]


def test_maintenance_of_an_unknown_valve_is_refused(stemwatch, plant: Path) -> None:
    """A valve that neither store nor plant knows ends with 2, its name and those like it."""
    outcome = stemwatch("maintenance", "FIC104", "--note", "x", "--plant", plant)
    assert outcome.status == 2
    assert "there is no valve 'FIC104' in this store; nearest: 'FIC-104'" in outcome.said
    queued = stemwatch("run-now", "FIC104", "--plant", plant)
    assert queued.status == 2
    assert "nearest: 'FIC-104'" in queued.said


@pytest.mark.parametrize(
    ("valve", "said"),
    [(STICKY, "becomes the new baseline"), (BLIND, "no baseline without a measured position")],
)
def test_what_follows_work_depends_on_whether_the_position_is_measured(
    stemwatch, plant: Path, valve: str, said: str
) -> None:
    """A baseline is a model of how MV follows OP: without MV none is promised."""
    outcome = stemwatch("maintenance", valve, "--note", "packing renewed", "--plant", plant)
    assert outcome.status == 0, outcome.said
    assert said in outcome.said


def test_maintenance_that_is_yet_to_come_is_refused(stemwatch, plant: Path) -> None:
    """A slip in the year ends with 2 and names the time as it was read."""
    when = ("--at", "2199-03-02T14:30+00:00")
    outcome = stemwatch("maintenance", "FIC-104", "--note", "x", "--plant", plant, *when)
    assert outcome.status == 2
    assert "2199-03-02 14:30 UTC has not come yet" in outcome.said


def test_maintenance_needs_a_store(stemwatch) -> None:
    """Without --plant and --db there is nowhere to keep the note."""
    outcome = stemwatch("maintenance", "FIC-104", "--note", "x")
    assert outcome.status == 2
    assert "give --plant plant.toml or --db URL" in outcome.said


def test_a_spoilt_baseline_is_said_and_costs_nothing(first, screened, plant: Path) -> None:
    """A baseline whose bytes are damaged is reported; the valve is screened all the same."""
    with closing(sqlite3.connect(plant.parent / "stemwatch.db")) as connection:
        connection.execute("UPDATE networks SET network = x'00112233' WHERE kind = 'baseline'")
        connection.commit()
    second = screened(*LATE)
    assert second["verdict"] == "sticky"
    assert "cannot be read" in second["baseline"]
    assert second["residuals"]["baseline"] is None
