"""What ``stemwatch screen`` answers to wrong usage, and how it understands a window."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

WRONG = {
    "nothing to screen": ((), "give a file, a folder or --plant plant.toml"),
    "position without command": (("x.csv", "--mv", "ZT"), "the controller output is needed: --op"),
    "no such plant file": (("--plant", "gone.toml"), "there is no file gone.toml"),
    "not a time": (("x.csv", "--from", "yesterday"), "'yesterday' is not a time; expected ISO"),
    "not a zone": (
        ("x.csv", "--from", "2026-03-02", "--zone", "CEST"),
        "zone 'CEST' is not known; expected an IANA time zone such as Europe/Berlin",
    ),
    "window backwards": (
        ("x.csv", "--from", "2026-03-03", "--to", "2026-03-02"),
        "--from 2026-03-03 00:00:00+00:00 is not before --to 2026-03-02 00:00:00+00:00",
    ),
    "no such verdict": (("x.csv", "--fail-on", "broken"), "'broken' is not one of"),
    "no workers": (("x.csv", "--workers", "0"), "Invalid value for '--workers'"),
    "no such option": (("x.csv", "--quick"), "No such option"),
    "a unit without a plant": (("x.csv", "--unit", "200"), "--unit needs --plant plant.toml"),
    "no database": (("x.csv", "--db", "oracle://x"), "the store needs SQLite or PostgreSQL"),
}


@pytest.mark.parametrize(("arguments", "says"), WRONG.values(), ids=WRONG.keys())
def test_wrong_usage_ends_with_status_2_and_a_sentence(
    stemwatch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple, says: str
) -> None:
    """Each mistake ends with 2 and a sentence that says what was found and expected."""
    monkeypatch.chdir(tmp_path)
    outcome = stemwatch("screen", *arguments)
    assert outcome.status == 2
    assert says in outcome.said
    assert "Traceback" not in outcome.said


WINDOWS = {
    "with an offset": (("--from", "2026-03-02T06:03+00:00", "--to", "2026-03-02T06:13+00:00"), 3),
    "in another offset": (
        ("--from", "2026-03-02T07:03+01:00", "--to", "2026-03-02T07:13+01:00"),
        3,
    ),
    "in the zone given": (
        ("--from", "2026-03-02T07:03", "--to", "2026-03-02T07:13", "--zone", "Europe/Berlin"),
        3,
    ),
    "without any zone, in UTC": (("--from", "2026-03-02T06:03", "--to", "2026-03-02T06:13"), 3),
    "open at its end": (("--from", "2026-03-02T06:05Z"), 5),
}


@pytest.mark.parametrize(("window", "first"), WINDOWS.values(), ids=WINDOWS.keys())
def test_from_and_to_are_instants_in_any_zone(
    stemwatch, one_valve: Path, tmp_path: Path, window: tuple[str, ...], first: int
) -> None:
    """--from and --to are instants, whatever zone they are said in."""
    file = tmp_path / "found.json"
    outcome = stemwatch(
        "screen", one_valve, *window, "--out", tmp_path / "out", "--json", file, "--workers", 1
    )
    assert outcome.status == 0, outcome.said
    last = 13 if "--to" in window else 15
    for valve in json.loads(file.read_text(encoding="utf-8")):
        assert {
            "start": f"2026-03-02T06:{first:02}:00+00:00",
            "end": f"2026-03-02T06:{last:02}:00+00:00",
        } == valve["window"]


def test_a_bare_time_is_in_the_plants_zone(stemwatch, plant: Path, tmp_path: Path) -> None:
    """With a plant file, a bare time is the plant's local time."""
    file = tmp_path / "found.json"
    outcome = stemwatch(
        "screen", "--plant", plant, "--from", "2026-03-02T07:05", "--out", tmp_path / "out",
        "--json", file, "--workers", 1,
    )  # fmt: skip
    assert outcome.status == 0, outcome.said
    starts = {v["window"]["start"] for v in json.loads(file.read_text(encoding="utf-8"))}
    assert starts == {"2026-03-02T06:05:00+00:00"}


def test_a_window_outside_the_export_says_what_the_export_holds(
    stemwatch, export: Path, tmp_path: Path
) -> None:
    """A window outside the export ends with 2 and says what the export holds."""
    outcome = stemwatch(
        "screen", export, "--from", "2027-01-01T00:00Z", "--out", tmp_path, "--workers", 1
    )
    assert outcome.status == 2
    assert "2026-03-02" in outcome.said


@pytest.mark.long
def test_a_window_of_times_without_zone_asks_for_the_zone(
    stemwatch, one_valve: Path, tmp_path: Path
) -> None:
    """Times without a zone cannot be cut to a window; the message says to give --zone."""
    file = tmp_path / "local.csv"
    file.write_text(one_valve.read_text(encoding="utf-8").replace("+01:00", ""), encoding="utf-8")
    arguments = ("screen", file, "--from", "2026-03-02T07:05", "--out", tmp_path, "--workers", 1)
    refused = stemwatch(*arguments)
    assert refused.status == 2
    assert "zone" in refused.said
    assert stemwatch(*arguments, "--zone", "Europe/Berlin").status == 0
