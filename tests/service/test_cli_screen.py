"""``stemwatch screen``: every way to say what to screen, and what it leaves behind."""

from __future__ import annotations

import csv
import gzip
import json
import shutil
import sqlite3
from pathlib import Path
from typing import Any

import pytest

from stemwatch.service.store.store import open_store

PAIR = ("--op", "FIC-104.OP", "--mv", "FIC-104.ZT")


@pytest.fixture
def screened(stemwatch, tmp_path: Path):
    """Screens with one worker into a folder of its own; gives outcome and contract objects."""

    def screen(*arguments: object) -> tuple[Any, list[dict[str, Any]]]:
        out = tmp_path / "out"
        outcome = stemwatch("screen", *arguments, "--out", out, "--workers", 1)
        file = out / "valves.json"
        valves = json.loads(file.read_text(encoding="utf-8")) if file.exists() else []
        return outcome, valves

    return screen


def verdicts(valves: list[dict[str, Any]]) -> dict[str, str]:
    return {valve["valve"]: valve["verdict"] for valve in valves}


def test_op_and_mv_screen_one_valve_named_after_the_file(screened, one_valve: Path) -> None:
    """--op and --mv screen one valve; without --valve it has the file's name."""
    outcome, valves = screened(one_valve, *PAIR)
    assert outcome.status == 0
    assert verdicts(valves) == {"historian": "sticky"}
    assert "sticky historian" in outcome.said
    assert "historian read: OP FIC-104.OP, MV FIC-104.ZT; without PV and SP" in outcome.said


def test_all_roles_and_the_valve_name_can_be_given(screened, one_valve: Path) -> None:
    """All roles can be named on the command line, and so can the valve."""
    more = ("--pv", "FIC-104.PV", "--sp", "FIC-104.SP", "--mode", "FIC-104.MODE")
    outcome, valves = screened(one_valve, *PAIR, *more, "--valve", "Recycle gas")
    assert outcome.status == 0
    assert verdicts(valves) == {"Recycle gas": "sticky"}


@pytest.mark.long
def test_without_tags_all_valves_with_certain_roles_are_screened(screened, export: Path) -> None:
    """Roles that tags leave no doubt about are found, and all valves of the file screened."""
    outcome, valves = screened(export)
    assert outcome.status == 0
    assert verdicts(valves) == {
        "FIC-104": "sticky",
        "FIC-113": "undetermined",
        "FIC-107": "healthy",
    }


@pytest.mark.long
def test_a_plant_file_screens_its_own_sources(screened, plant: Path) -> None:
    """--plant alone screens every valve, worst first, and keeps results beside the plant file."""
    outcome, valves = screened("--plant", plant)
    assert outcome.status == 0
    assert ["sticky", "undetermined", "healthy"] == [valve["verdict"] for valve in valves]
    assert (plant.parent / "stemwatch.db").is_file()
    counts = "1 of 3 valves needs work; 1 cannot be judged (1 with a work order to find out why)"
    assert f"{counts}, 1 without work." in outcome.said


def test_a_source_beside_a_plant_file_is_read_by_its_tags(
    screened, plant: Path, one_valve: Path
) -> None:
    """With a source given, the plant's tags are looked for in that file."""
    outcome, valves = screened(one_valve, "--plant", plant)
    assert outcome.status == 0
    assert verdicts(valves) == {"FIC-104": "sticky"}
    assert valves[0]["recording"] == str(one_valve)


def test_a_gzip_file_is_screened_under_its_plain_name(
    screened, one_valve: Path, tmp_path: Path
) -> None:
    """A .gz is read as it is, and the valve's name has neither ending."""
    file = tmp_path / "unit7.csv.gz"
    file.write_bytes(gzip.compress(one_valve.read_bytes()))
    outcome, valves = screened(file, *PAIR)
    assert outcome.status == 0
    assert verdicts(valves) == {"unit7": "sticky"}


@pytest.fixture
def folder(one_valve: Path, tmp_path: Path) -> Path:
    """A folder with two good exports, a broken one and notes."""
    path = tmp_path / "exports"
    (path / "older").mkdir(parents=True)
    shutil.copy(one_valve, path / "monday.csv")
    shutil.copy(one_valve, path / "older" / "sunday.csv")
    (path / "cut.csv").write_text("Time,FIC-104.OP,FIC-104.ZT\n", encoding="utf-8")
    (path / "read me.txt").write_text("Exported by Anna.\n", encoding="utf-8")
    (path / "picture.png").write_bytes(b"\x89PNG")
    return path


def test_bad_files_of_a_folder_are_reported_and_good_ones_screened(screened, folder: Path) -> None:
    """Good files are screened, bad ones reported by name and reason, and the status is 0."""
    outcome, valves = screened(folder, *PAIR)
    assert outcome.status == 0
    assert verdicts(valves) == {"monday": "sticky", "sunday": "sticky"}
    for name in ("cut.csv", "read me.txt"):
        assert f"left out: {folder / name}" in outcome.said
    assert "picture.png" not in outcome.said
    report = (folder.parent / "out" / "report.html").read_text(encoding="utf-8")
    assert "cut.csv" in report


def test_a_pattern_screens_the_files_it_matches_and_no_others(screened, folder: Path) -> None:
    """A pattern that the shell did not expand names the files it matches and no others."""
    outcome, valves = screened(folder / "mon*.csv", *PAIR)
    assert outcome.status == 0
    assert verdicts(valves) == {"monday": "sticky"}


def test_a_bad_file_named_by_hand_is_a_result_with_its_reason(screened, folder: Path) -> None:
    """A file named by hand is a result with a reason; the good one is screened all the same."""
    outcome, valves = screened(folder / "cut.csv", folder / "monday.csv", *PAIR)
    assert outcome.status == 0
    assert verdicts(valves) == {"monday": "sticky", "cut": "undetermined"}
    assert "cut.csv" in next(v["reason"] for v in valves if v["valve"] == "cut")


def test_a_folder_without_recordings_is_an_error(screened, tmp_path: Path) -> None:
    """A folder without recordings ends with 2 and says so."""
    (tmp_path / "empty").mkdir()
    outcome, _ = screened(tmp_path / "empty")
    assert outcome.status == 2
    assert "nothing could be screened" in outcome.said


def test_a_pattern_without_a_file_is_an_error(screened, tmp_path: Path) -> None:
    """A pattern without a file ends with 2, naming it and what would be right."""
    outcome, _ = screened(tmp_path / "gone*.csv")
    assert outcome.status == 2
    assert "gone*.csv: no such file, folder or pattern; expected for example" in outcome.said


def test_a_missing_tag_names_the_nearest(screened, one_valve: Path) -> None:
    """A misspelt tag ends with 2 and proposes what was probably meant."""
    outcome, _ = screened(one_valve, "--op", "FIC-104.OPP", "--mv", "FIC-104.ZT")
    assert outcome.status == 2
    assert "there is no tag 'FIC-104.OPP'" in outcome.said
    assert "nearest are 'FIC-104.OP'" in outcome.said


def test_two_missing_tags_are_said_at_once(screened, one_valve: Path) -> None:
    """Two typing errors are not two tries."""
    outcome, _ = screened(one_valve, "--op", "NOPE.OP", "--mv", "NOPE.ZT")
    assert outcome.status == 2
    assert "there is no tag 'NOPE.OP'" in outcome.said
    assert "there is no tag 'NOPE.ZT'" in outcome.said


def export_of(file: Path, heading: str, periods: tuple[int, ...]) -> Path:
    """``file`` with five minutes of a sawtooth of each of ``periods``, in samples of 1 s."""
    rows = [
        ",".join([f"2026-03-02T06:{k // 60:02}:{k % 60:02}Z", *(str(k % n) for n in periods)])
        for k in range(300)
    ]
    file.write_text("\n".join([heading, *rows]), encoding="utf-8")
    return file


def test_a_file_without_a_recognised_op_says_what_to_do(screened, tmp_path: Path) -> None:
    """Numbers without a recognisable OP are no failure: status 0, and what to do is said."""
    file = export_of(tmp_path / "tanks.csv", "Time,upper,lower", (7, 5))
    outcome, valves = screened(file)
    assert outcome.status == 0
    assert verdicts(valves) == {"tanks": "undetermined"}
    assert "no controller output was recognised" in outcome.said
    assert "--op" in outcome.said
    assert "upper" in " ".join(valves[0]["still_seen"])


def test_a_file_of_one_tag_says_that_the_others_belong_into_it(screened, tmp_path: Path) -> None:
    """One file per tag: how the tags of a loop come into one file is said."""
    outcome, _ = screened(export_of(tmp_path / "FIC1.OP.csv", "Timestamp,Value", (7,)))
    assert outcome.status == 0
    assert "this file holds one tag only" in outcome.said
    assert "time, tag, value" in outcome.said


def test_json_is_the_reports_own(screened, export: Path, tmp_path: Path) -> None:
    """--json writes byte for byte the objects of the report, one for each valve, worst first."""
    file = tmp_path / "mine.json"
    outcome, valves = screened(export, "--json", file)
    assert outcome.status == 0
    assert valves == json.loads(file.read_text(encoding="utf-8"))
    assert [2, 2, 2] == [valve["version"] for valve in valves]


def test_the_report_is_four_files_that_agree(screened, export: Path, tmp_path: Path) -> None:
    """HTML, CSV, XLSX and JSON are there, and the CSV ranks as the JSON does."""
    outcome, valves = screened(export)
    out = tmp_path / "out"
    assert outcome.status == 0
    assert {"report.html", "valves.csv", "valves.xlsx", "valves.json", "stemwatch.db"} <= {
        path.name for path in out.iterdir()
    }
    with (out / "valves.csv").open(encoding="utf-8-sig", newline="") as table:
        rows = list(csv.DictReader(table))
    assert [valve["valve"] for valve in valves] == [row["valve"] for row in rows]
    assert str(out / "report.html") in outcome.out


@pytest.mark.long
@pytest.mark.parametrize(("verdict", "status"), [("sticky", 1), ("watch", 0)])
def test_findings_count_where_asked(screened, one_valve: Path, verdict: str, status: int) -> None:
    """--fail-on ends with 1 where a valve has that verdict and with 0 where none has."""
    outcome, _ = screened(one_valve, "--fail-on", verdict)
    assert status == outcome.status


def test_limits_of_the_plant_file_decide(screened, plant: Path) -> None:
    """A plant that tolerates much stiction calls the same valve healthy."""
    limits = "[limits]\nwatch_S_percent = 9.0\nsticky_S_percent = 12.0\n\n"
    plant.write_text(limits + plant.read_text(encoding="utf-8"), encoding="utf-8")
    outcome, valves = screened("--plant", plant)
    assert outcome.status == 0
    assert verdicts(valves)["FIC-104"] != "sticky"


@pytest.mark.long
def test_a_mistake_in_the_plant_file_costs_one_valve(screened, plant: Path) -> None:
    """A valve with a misspelt key is reported with its line; the others are screened."""
    text = plant.read_text(encoding="utf-8").replace("criticality = 3", "critcality = 3", 1)
    plant.write_text(text, encoding="utf-8")
    outcome, valves = screened("--plant", plant)
    line = text[: text.index("critcality")].count("\n") + 1
    assert outcome.status == 0
    assert "critcality" in outcome.err
    assert f"line {line}" in outcome.said or f":{line}" in outcome.said
    assert len(valves) >= 2


def test_a_valve_whose_tag_is_nowhere_is_reported(screened, plant: Path) -> None:
    """A valve that no export holds is undetermined with the reason; the rest goes on."""
    text = plant.read_text(encoding="utf-8").replace('"FIC-107.OP"', '"FIC-777.OP"')
    plant.write_text(text, encoding="utf-8")
    outcome, valves = screened("--plant", plant)
    assert outcome.status == 0
    assert verdicts(valves)["FIC-104"] == "sticky"
    reason = next(v["reason"] for v in valves if v["valve"] == "FIC-107")
    assert "the OP tag FIC-777.OP is in none of the source's files" in reason


FAILING = {
    "a wrong tag": ("one_valve", ("--op", "NOPE"), "there is no tag 'NOPE'"),
    "an empty file": (b"", PAIR, "the file is empty"),
    "a binary file": (bytes(range(256)) * 20, PAIR, "is not text"),
    "an empty folder": (None, (), "the folder is empty"),
}


@pytest.mark.parametrize(
    ("source", "more", "why"),
    [
        pytest.param(*failing, id=name, marks=[] if name == "a wrong tag" else [pytest.mark.long])
        for name, failing in FAILING.items()
    ],
)
def test_a_failed_run_leaves_the_last_report_as_it_was(
    screened, one_valve: Path, tmp_path: Path, source: Any, more: tuple[str, ...], why: str
) -> None:
    """Nothing could be read: the reason is told once, no table is shown and no file is written."""
    good, _ = screened(one_valve, *PAIR)
    out = tmp_path / "out"
    before = {path.name: path.read_bytes() for path in out.iterdir() if path.suffix[:3] != ".db"}
    broken = one_valve
    if source != "one_valve":
        broken = tmp_path / "broken.csv"
        broken.mkdir() if source is None else broken.write_bytes(source)
    outcome, _ = screened(broken, *more)
    after = {path.name: path.read_bytes() for path in out.iterdir() if path.suffix[:3] != ".db"}
    assert good.status == 0
    assert outcome.status == 2
    assert after == before
    assert outcome.said.count(why) == 1
    assert outcome.said.count("nothing could be screened") == 1
    assert "verdict" not in outcome.out
    assert "Report:" not in outcome.out


@pytest.mark.parametrize(("source", "more", "why"), FAILING.values(), ids=FAILING.keys())
def test_a_failed_first_run_leaves_nothing(
    screened, one_valve: Path, tmp_path: Path, source: Any, more: tuple[str, ...], why: str
) -> None:
    """No folder, no empty database, which would look like a plant without a valve."""
    broken = one_valve
    if source != "one_valve":
        broken = tmp_path / "broken.csv"
        broken.mkdir() if source is None else broken.write_bytes(source)
    for where in ((), ("--db", f"sqlite:///{tmp_path / 'other.db'}")):
        outcome, _ = screened(broken, *more, *where)
        assert outcome.status == 2
        assert outcome.said.count(why) == 1
        assert not (tmp_path / "out").exists()
        assert list(tmp_path.glob("*.db*")) == []


def test_results_that_could_not_be_saved_are_told_by_the_exit_status(
    screened, one_valve: Path, tmp_path: Path
) -> None:
    """The report is there and says them; who starts the command every night learns the rest."""
    path = tmp_path / "kept.db"
    with open_store(f"sqlite:///{path}"), sqlite3.connect(path) as raw:
        raw.execute(
            "CREATE TRIGGER refused BEFORE INSERT ON screenings "
            "BEGIN SELECT RAISE(ABORT, 'refused'); END"
        )
    raw.close()
    outcome, valves = screened(one_valve, *PAIR, "--db", f"sqlite:///{path}", "--fail-on", "sticky")
    assert outcome.status == 2
    assert verdicts(valves) == {"historian": "sticky"}
    assert "not saved: refused: historian. The report has these results" in outcome.said
    assert "Report:" in outcome.out


def test_a_failed_run_keeps_the_database_of_the_last_one(
    screened, one_valve: Path, tmp_path: Path
) -> None:
    """What a run before has stored stays."""
    screened(one_valve, *PAIR)
    outcome, _ = screened(one_valve, "--op", "NOPE")
    assert outcome.status == 2
    with open_store(f"sqlite:///{tmp_path / 'out' / 'stemwatch.db'}") as store:
        assert len(store.screenings("historian", 5)) == 1
