"""Real recordings, screened as a user would: no verdict where none is possible, and never a crash.

Nothing here knows a tag or a file beyond what a user must say on the command line.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

pytestmark = [pytest.mark.recordings, pytest.mark.early]

QUICK = ("uolab", "emps", "cascaded_tanks", "historian_faults")
LARGE = ("refinery", "isdb")
WITHOUT_POSITION = [*QUICK, *(pytest.param(folder, marks=pytest.mark.long) for folder in LARGE)]
FOLDERS = [pytest.param("damadics", marks=pytest.mark.long), *WITHOUT_POSITION]
Valves = list[dict[str, Any]]
Screened = Callable[..., tuple[Any, Valves]]


@pytest.fixture(scope="module")
def screened(stemwatch, recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Screened:
    """Screens a folder or file of the recordings; the same arguments are screened once."""

    @cache
    def screen(source: str, *arguments: str) -> tuple[Any, Valves]:
        out = tmp_path_factory.mktemp("recordings")
        outcome = stemwatch("screen", recordings / source, *arguments, "--out", out, "--workers", 1)
        return outcome, json.loads((out / "valves.json").read_text(encoding="utf-8"))

    return screen


def labels(recordings: Path, folder: str, key: str, value: str) -> dict[str, str]:
    with (recordings / folder / "labels.csv").open(encoding="utf-8", newline="") as table:
        return {row[key]: row[value] for row in csv.DictReader(table)}


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_folder_is_screened(screened: Screened, folder: str) -> None:
    """Each folder ends with 0; whoever gets no verdict gets the reason and what is still seen."""
    outcome, valves = screened(folder)
    assert outcome.status == 0, outcome.said
    assert valves
    silent = [
        valve["recording"]
        for valve in valves
        if valve["verdict"] == "undetermined"
        and not (
            valve["reason"].startswith("Cannot tell: ")
            and valve["advice"]
            and valve["still_seen"]
            and valve["stiction"]["S"]["reason"]
        )
    ]
    assert [] == silent


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_fit_breaks_down(screened: Screened, folder: str) -> None:
    """No real recording makes the computation fail."""
    _, valves = screened(folder)
    assert [] == [valve["reason"] for valve in valves if "broke down" in valve["reason"]]


@pytest.mark.parametrize("folder", WITHOUT_POSITION)
def test_no_verdict_without_a_position(screened: Screened, folder: str) -> None:
    """Only one folder has a measured position that is found by itself: no other has a verdict."""
    _, valves = screened(folder)
    assert {"undetermined"} == {valve["verdict"] for valve in valves}


DAMADICS = ("damadics/lublin_actuator3_one_hour.csv", "--op", "LC74_20CV_pct")


@pytest.mark.parametrize(
    "arguments",
    [
        ("damadics",),
        pytest.param((*DAMADICS, "--mv", "LC74_20X_pct"), marks=pytest.mark.long),
    ],
    ids=["found", "named"],
)
def test_a_speed_limit_is_not_taken_for_stiction(
    screened: Screened, arguments: tuple[str, ...]
) -> None:
    """The healthy actuator with a slow direction is not sticky: S is below 2 %, not near 10; nor is
    a stroke as slow as large actuators have a defect."""
    outcome, (valve,) = screened(*arguments)
    assert outcome.status == 0
    assert valve["verdict"] == valve["stem_verdict"]
    assert valve["stem_verdict"] in ("healthy", "watch")
    S = valve["stiction"]["S"]
    assert 0.0 <= S["low"] <= S["value"] <= S["high"] < 2.0
    results = {name: item["value"] for name, item in valve["indicators"].items()}
    assert results["naive_S_percent"] > 5.0
    assert 0.5 < results["dead_time_s"] < 1.5
    assert 2.0 < results["speed_falling_percent_per_s"] < 4.5
    assert "speed_rising_percent_per_s" not in results
    assert valve["residuals"]["stiction"]["fit"] > 60.0


@pytest.mark.long
def test_the_position_is_found_without_being_named(screened: Screened) -> None:
    """Without --op, --mv and --pv the same columns are taken, and the same numbers come out."""
    _, (named,) = screened(*DAMADICS, "--mv", "LC74_20X_pct", "--pv", "LC74_20PV_pct")
    _, (result,) = screened("damadics")
    assert named["stiction"] == result["stiction"]


def test_a_position_that_is_missing_is_not_made_up(screened: Screened) -> None:
    """The same hour without its position has no verdict."""
    _, (valve,) = screened(*DAMADICS)
    assert valve["verdict"] == "undetermined"
    assert "there is no valve position" in valve["reason"]


@pytest.mark.long
def test_every_refinery_file_is_read(screened: Screened, recordings: Path) -> None:
    """All recordings are screened, the table of labels is left out, and both by name."""
    outcome, valves = screened("refinery")
    labelled = labels(recordings, "refinery", "file", "tag")
    names = {Path(valve["recording"]).name for valve in valves}
    assert names == {name if name.endswith(".txt") else f"{name}.txt" for name in labelled}
    assert "labels.csv: no row of numbers was found" in outcome.said


@pytest.mark.long
def test_a_state_code_is_no_measurement(screened: Screened) -> None:
    """Where PV is a state code read as a float, that is what is said of it."""
    _, valves = screened("refinery")
    coded = [v for v in valves if any("PV holds state codes" in s for s in v["still_seen"])]
    assert 2 == len(coded)
    assert all("hardly any usable sample" in " ".join(valve["still_seen"]) for valve in coded)


@pytest.mark.long
def test_an_output_that_is_not_percent_is_not_read_as_percent(screened: Screened) -> None:
    """An OP of 389 to 396 is said not to be percent."""
    _, valves = screened("refinery")
    (valve,) = [v for v in valves if "not in percent" in " ".join(v["still_seen"])]
    assert "unknown unit" in " ".join(valve["quality"]["reasons"])


@pytest.mark.long
def test_an_oscillation_is_seen_and_not_blamed_on_the_valve(
    screened: Screened, recordings: Path
) -> None:
    """Loops with a healthy and with a sticking valve oscillate; both are told alike."""
    _, valves = screened("isdb")
    truth = labels(recordings, "isdb", "loop", "label")
    cycling = [v for v in valves if any("OP oscillates" in s for s in v["still_seen"])]
    assert {"stiction", "disturbance"} <= {truth[valve["valve"]] for valve in cycling}
    assert all("a disturbance can all do this" in " ".join(v["still_seen"]) for v in cycling)


@pytest.mark.parametrize(
    ("files", "op", "flow"),
    [("*400B*", "FIC-400B", "FIT-400B"), ("*400C*", "FIC-400C", "FIT-400C")],
)
def test_a_flow_is_not_taken_for_a_position(
    screened: Screened, files: str, op: str, flow: str
) -> None:
    """A flow given as position is refused because its unit is not percent."""
    tags = ("--op", f"{op}/BLOCK1/OUT.CV", "--mv", f"{flow}/AI1/OUT.CV")
    outcome, valves = screened(f"uolab/{files}.csv", *tags)
    assert outcome.status == 0
    assert 2 == len(valves)
    for valve in valves:
        assert "is in gal/min, not in percent of travel" in valve["reason"]


def test_a_staircase_without_a_jump_is_not_surely_said_to_jump(
    stemwatch, recordings: Path, tmp_path: Path
) -> None:
    """The flow valve 400C has a dead band of about 8 % and no slip jump: the intervals say so."""
    files = sorted((recordings / "uolab").glob("*400C*.csv"))
    tags = ("--op", "FIC-400C/BLOCK1/OUT.CV", "--mv", "FIT-400C/AI1/OUT.CV")
    options = ("--no-narx", "--workers", 1, "--json", tmp_path / "explained.json")
    assert stemwatch("explain", *files, *tags, *options).status == 0
    explained = json.loads((tmp_path / "explained.json").read_text(encoding="utf-8"))
    assert len(explained) == 2
    for valve in explained:
        S, J = (valve["stiction"]["restated"][name] for name in ("S", "J"))
        assert S["low"] <= 8.1 <= S["high"]
        assert J["low"] == 0.0


def test_no_wave_begins_in_a_loop_whose_output_stands_at_its_limit(screened: Screened) -> None:
    """One valve of a rig is stepped by hand, and four loops measure the same flow. The speed loop,
    whose OP takes another value once in half an hour, shows the purest wave and was once named as
    its source at over 99 %. Nine cycles do not tell such a wave from chance: no group is claimed.
    """
    outcome, valves = screened("uolab/*400B*Opening.csv")
    assert outcome.status == 0
    groups = {valve["valve"]: valve["oscillates_with"] for valve in valves}
    assert {"FSC-400A", "FIC-400B"} <= groups.keys()
    assert groups["FSC-400A"] == []


def test_a_recording_of_25_seconds_is_judged_by_its_samples(screened: Screened) -> None:
    """Five thousand samples 5 ms apart are enough to see that a force given as command is no
    position: neither a defect nor health, and the advice says which tag to map."""
    tags = ("--op", "u_in", "--mv", "q_meas")
    outcome, (valve,) = screened("emps/emps_estimation.csv", *tags)
    assert outcome.status == 0
    assert (valve["verdict"], valve["stem_verdict"]) == ("undetermined", "undetermined")
    assert valve["stiction"]["S"]["value"] is None
    assert "OP is a speed, a force or" in valve["reason"]
    assert valve["advice"].startswith("Check that OP is what this valve is told")


def test_two_tanks_are_not_a_sticking_valve(screened: Screened) -> None:
    """A pump and a level given as a pair get no verdict of stiction."""
    tags = ("--op", "uEst", "--mv", "yEst", "--interval-s", "4")
    outcome, (valve,) = screened("cascaded_tanks", *tags)
    assert outcome.status == 0
    assert valve["verdict"] == "undetermined"


def test_the_faults_of_a_poor_archive_are_found(screened: Screened) -> None:
    """Gap, coarse OP, coarse PV and a saturated OP are all said."""
    _, (valve,) = screened("historian_faults")
    text = " ".join([*valve["quality"]["reasons"], *valve["still_seen"]])
    for fact in (
        "1 gap of 13.8 min",
        "OP is recorded in steps of 1 %",
        "PV is recorded in steps of 0.01",
        "OP is at its lower limit for 33 % of the time",
    ):
        assert fact in text


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_file_can_be_inspected(stemwatch, recordings: Path, folder: str) -> None:
    """``inspect`` understands the first recording of each folder and proposes a mapping."""
    files = [p for p in sorted((recordings / folder).iterdir()) if p.suffix in (".csv", ".txt")]
    file = next(path for path in files if path.stem not in ("labels", "README"))
    outcome = stemwatch("inspect", file)
    assert outcome.status == 0, outcome.said
    assert "[[sources]]" in outcome.out
