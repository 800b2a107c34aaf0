"""``stemwatch demo`` and ``simulate``: what a newcomer sees, marked against the truth."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from stemwatch.models.studies import simulator
from stemwatch.models.studies.simulator import demo_plant, weeks_before
from stemwatch.service.config import load_plant
from stemwatch.service.explain.explain_json import to_object
from stemwatch.service.explain.explain_recording import Job, explain_one
from stemwatch.service.explain.requested_recordings import recordings_to_explain
from stemwatch.service.run.plan import Request
from tests.shared_setup import made_once

pytestmark = pytest.mark.early

WHOLE = pytest.param("whole", marks=pytest.mark.long)
# One that sticks and has earlier weeks, one healthy, one without position, one that vents slowly.
FEW = ("FIC-104", "FIC-107", "FIC-113", "FIC-115")


@pytest.fixture(scope="module", params=["few", WHOLE])
def demo(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, stemwatch
) -> Path:
    """The folder that one run of the demonstration leaves: of the whole plant, or of ``FEW`` valves
    with one earlier week."""
    whole = request.param == "whole"
    of_few = {
        "demo_plant": lambda seed: [loop for loop in demo_plant(seed) if loop.tag in FEW],
        "weeks_before": lambda seed: weeks_before(seed)[-1:],
    }

    def run(folder: Path) -> None:
        with pytest.MonkeyPatch.context() as patched:
            for name, instead in ({} if whole else of_few).items():
                patched.setattr(simulator, name, instead)
            outcome = stemwatch("demo", "--out", folder / "plant", "--workers", 2 if whole else 1)
        assert outcome.status == 0, outcome.said
        assert "Open the report in a browser" in outcome.said

    return made_once(tmp_path_factory, f"demo_{request.param}", run) / "plant"


@pytest.fixture(scope="module")
def result(demo: Path) -> dict[str, dict[str, Any]]:
    """The report's object of each valve."""
    valves = json.loads((demo / "report" / "valves.json").read_text(encoding="utf-8"))
    return {valve["valve"]: valve for valve in valves}


@pytest.fixture(scope="module")
def truth(demo: Path) -> dict[str, dict[str, Any]]:
    """What was simulated, of each valve."""
    marks = json.loads((demo / "truth.json").read_text(encoding="utf-8"))
    return {valve["tag"]: valve for valve in marks["valves"]}


def told_of(truth: dict[str, dict[str, Any]], words: str) -> set[str]:
    return {tag for tag, valve in truth.items() if words in valve["story"]}


def test_the_demo_leaves_report_database_and_plant_file(demo: Path) -> None:
    """Everything that the main job makes is there, and the plant file is right."""
    for name in ("plant.toml", "truth.json", "export/historian.csv", "stemwatch.db"):
        assert (demo / name).is_file(), name
    for name in ("report.html", "valves.csv", "valves.xlsx", "valves.json"):
        assert (demo / "report" / name).stat().st_size > 1000, name
    plant = load_plant(demo / "plant.toml")
    assert plant.problems == ()
    with closing(sqlite3.connect(demo / "stemwatch.db")) as connection:
        counts = connection.execute("SELECT count(*), count(DISTINCT valve) FROM screenings")
        # The whole plant has five earlier weeks of one valve.
        valves, weeks = (15, 5) if len(plant.valves) > len(FEW) else (len(FEW), 1)
        assert (valves + weeks, valves) == counts.fetchone()


def test_no_healthy_valve_of_the_demo_is_called_sticky(result, truth) -> None:
    """Bad tuning, disturbances, bad data and a frozen transmitter are not taken for stiction."""
    healthy = {tag for tag, valve in truth.items() if valve["healthy"]}
    assert len(healthy) == (10 if len(truth) > len(FEW) else 2)
    assert set() == {tag for tag in healthy if result[tag]["verdict"] == "sticky"}


def test_the_hidden_physics_of_the_demo_is_named(result) -> None:
    """The valve that vents slowly and is told late: both are named, and the fit grows."""
    mismatch = result["FIC-115"]["mismatch"]
    named = {slug for effect in mismatch["effects"] for slug in effect["class"]}
    assert {"dead_time", "asymmetric_rate_limit"} <= named
    assert mismatch["stiction"]["restated"]["S"]["value"] < 1.0
    assert mismatch["heldout"]["rmse_extended"] < 0.5 * mismatch["heldout"]["rmse_naive"]


def test_every_sticking_valve_with_a_position_is_found(result, truth) -> None:
    """The four shapes of stiction are sticky, and S is within one percent of what was simulated."""
    sticking = told_of(truth, "sticky") - told_of(truth, "no position transmitter")
    assert len(sticking) == (4 if len(truth) > len(FEW) else 1)
    assert {tag: "sticky" for tag in sticking} == {tag: result[tag]["verdict"] for tag in sticking}
    wide = {t: (truth[t]["S"], result[t]["stiction"]["S"]) for t in sticking}
    assert {} == {t: p for t, p in wide.items() if abs(p[0] - p[1]["value"]) > 1.0}


@pytest.mark.parametrize(
    ("demo", "story", "says"),
    [
        ("few", "no position transmitter", "no valve position"),
        *(
            pytest.param("whole", story, says, marks=pytest.mark.long)
            for story, says in (
                ("frozen", "frozen"),
                ("no position transmitter", "no valve position"),
                ("manual", "manual"),
                ("too few movements", "OP moved over"),
            )
        ),
    ],
    indirect=["demo"],
)
def test_what_cannot_be_judged_is_said_with_the_reason(
    result, truth, story: str, says: str
) -> None:
    """A valve whose recording allows no verdict has none, the reason, and what is still seen."""
    (tag,) = told_of(truth, story)
    valve = result[tag]
    assert valve["verdict"] == "undetermined"
    assert says in valve["reason"]
    assert valve["advice"]
    assert valve["still_seen"]
    assert valve["stiction"]["S"]["value"] is None


@pytest.mark.long
def test_explain_tells_of_each_valve_what_its_report_tells(demo: Path, result) -> None:
    """S, J, what was left out, its sentence and its fit, to the last digit."""
    plant = load_plant(demo / "plant.toml")
    for valve in recordings_to_explain(Request(plant=plant)).valves:
        explained = to_object(explain_one(Job(to_explain=valve, narx=False)))
        reported = result[valve.valve]
        if reported["mismatch"] is None:
            assert explained["verdict"] != "none"
            assert reported["reason"] in explained["sentence"]
            continue
        assert explained["stiction"]["restated"] == reported["stiction"]
        for name in ("verdict", "sentence", "stiction", "not_testable"):
            assert explained[name] == reported["mismatch"][name], (valve.valve, name)
        slugs = [[effect["slug"] for effect in one] for one in (
            explained["effects"], reported["mismatch"]["effects"],
        )]  # fmt: skip
        assert slugs[0] == slugs[1]


def test_simulate_writes_export_plant_file_and_truth(stemwatch, tmp_path: Path) -> None:
    """Random loops are written as asked: count, start and zone, with the truth beside."""
    outcome = stemwatch(
        "simulate", "--what", "sticky", "--count", 2, "--out", tmp_path,
        "--start", "2026-07-01T06:00", "--zone", "Asia/Tokyo",
    )  # fmt: skip
    assert outcome.status == 0
    marks = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert marks["start"] == "2026-06-30T21:00:00+00:00"
    assert [False, False] == [valve["healthy"] for valve in marks["valves"]]
    rows = (tmp_path / "export" / "historian.csv").read_text(encoding="utf-8").splitlines()
    assert rows[2].startswith("2026-07-01 06:00:00+09:00")
    assert [valve["tag"] for valve in marks["valves"]] == list(
        load_plant(tmp_path / "plant.toml").valves
    )
    for name in ("historian.csv", "plant.toml", "truth.json"):
        assert name in outcome.out


def test_the_same_seed_simulates_the_same_export(stemwatch, tmp_path: Path) -> None:
    """One seed gives one export, byte for byte, and another seed another."""
    exports = []
    for name, seed in (("a", 4), ("b", 4), ("c", 5)):
        status = stemwatch(
            "simulate", "--what", "healthy", "--count", 1, "--seed", seed, "--out", tmp_path / name
        ).status
        assert status == 0
        exports.append((tmp_path / name / "export" / "historian.csv").read_bytes())
    assert exports[0] == exports[1]
    assert exports[1] != exports[2]


def test_a_start_that_is_no_time_is_refused(stemwatch, tmp_path: Path) -> None:
    """A wrong --start ends with 2 before anything is written."""
    outcome = stemwatch("simulate", "--start", "soon", "--out", tmp_path / "x")
    assert outcome.status == 2
    assert "'soon' is not a time" in outcome.said
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("given", "unused"),
    [
        (("simulate", "--port", 5021), "--port"),
        (("simulate", "--wear-over-s", 60), "--wear-over-s"),
        (("simulate", "--modbus", "--start", "2026-07-01T06:00"), "--start"),
        (("simulate", "--modbus", "--zone", "Europe/Atlantis"), "--zone"),
        (("demo", "--open"), "--open"),
        (("demo", "--live", "--workers", 2), "--workers"),
    ],
)
def test_an_option_that_would_change_nothing_is_refused(stemwatch, tmp_path, given, unused) -> None:
    """Those of the live plant where none runs, and the other way round."""
    outcome = stemwatch(*given, "--out", tmp_path / "x")
    assert outcome.status == 2
    assert f"Invalid value for {unused}" in " ".join(outcome.said.replace("│", " ").split())
    assert not (tmp_path / "x").exists()


def test_a_count_of_the_demo_plant_is_refused(stemwatch, tmp_path: Path) -> None:
    """Its loops are always the same ones: --count would change nothing, and says so."""
    outcome = stemwatch("simulate", "--count", 2, "--out", tmp_path / "x")
    assert outcome.status == 2
    assert "--what healthy or --what sticky" in " ".join(outcome.said.replace("│", " ").split())
    assert not (tmp_path / "x").exists()
