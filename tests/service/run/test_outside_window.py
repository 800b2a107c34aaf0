"""Daily files and a window of one day: that day's file, and one sentence on the others."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.models.recording import Provenance, Role
from stemwatch.models.screening.screen import failed
from stemwatch.service.run.outside_window import OutsideWindow
from stemwatch.service.run.task import Task

START = datetime(2026, 3, 2, tzinfo=UTC)
SECOND_DAY = ("--from", "2026-03-03", "--to", "2026-03-04")
SENTENCE = "2 of 3 recordings have no samples in the window that was asked for and were left out."


def write_day(folder: Path, day: int) -> None:
    """A quarter of an hour of one loop on one day."""
    rng = np.random.default_rng(day)
    op = 50.0 + np.cumsum(rng.normal(size=900)) * 0.2
    rows = ["Time;FIC101.OP;FIC101.MV"]
    for k, value in enumerate(op):
        at = START + timedelta(days=day, seconds=k)
        rows.append(f"{at.isoformat()};{value:.3f};{value:.3f}")
    (folder / f"day{day}.csv").write_text("\n".join(rows) + "\n")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Three days."""
    exports = tmp_path / "exports"
    exports.mkdir()
    for day in range(3):
        write_day(exports, day)
    return exports


def test_files_outside_the_window_are_one_sentence(stemwatch, folder: Path, tmp_path: Path) -> None:
    """In report and terminal, and no result of theirs."""
    out = tmp_path / "report"
    outcome = stemwatch("screen", folder, *SECOND_DAY, "--out", out, "--workers", "1")
    assert outcome.status == 0, outcome.said
    (only,) = json.loads((out / "valves.json").read_text())
    assert only["window"]["start"].startswith("2026-03-03")
    assert SENTENCE in " ".join(outcome.said.split())
    assert SENTENCE in (out / "report.html").read_text()


def test_a_window_that_no_file_covers_is_an_error_with_what_they_cover(
    stemwatch, folder: Path, tmp_path: Path
) -> None:
    """Nothing was screened, and the reason says which dates there are."""
    arguments = ("--from", "2027-01-01", "--out", tmp_path / "report", "--workers", "1")
    outcome = stemwatch("screen", folder, *arguments)
    assert outcome.status != 0
    assert "nothing could be screened" in outcome.said
    assert "covers 2026-03-02 00:00:00" in " ".join(outcome.said.split())


def test_a_valve_of_the_plant_keeps_one_result() -> None:
    """Whatever order they arrive in: of a valve without any recording in the window one stays."""
    tags = {Role.OP: TagMapping(tag="OP")}
    tasks = [
        Task(path=f"{valve}{day}.csv", tags=ValveTags(valve=valve, tags=tags))
        for valve in ("A", "B")
        for day in range(3)
    ]
    inside = failed("A", "flat", "", Provenance(source="A1.csv"))
    outside = replace(inside, outside_window=True)
    of_plant = OutsideWindow(tasks, must_appear=True)
    assert [of_plant.leaves_out("A", one) for one in (outside, inside, outside)] == [1, 0, 1]
    assert [of_plant.leaves_out("B", outside) for _ in range(3)] == [1, 1, 0]
    assert of_plant.sentence.startswith("4 of 6 recordings have")
    of_files = OutsideWindow(tasks, must_appear=False)
    assert [of_files.leaves_out("B", outside) for _ in range(3)] == [1, 1, 1]
