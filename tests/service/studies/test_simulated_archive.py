"""The simulated archive: the same valves from Parquet and CSV, as they were simulated."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.service.config import load_plant
from stemwatch.service.executors import InProcess, LocalProcesses
from stemwatch.service.run.plan import Request, make_plan
from stemwatch.service.run.task import recording_of
from stemwatch.service.studies.simulated_archive import PIECE, ArchivePlan, Format, write_archive

PLAN = ArchivePlan(valves=3, hours=0.5, distinct=2, start=datetime(2026, 3, 1, 23, 45, tzinfo=UTC))


def written(folder: Path, form: Format):
    """The recordings of the archive, by valve, read through its own plant file."""
    plant = load_plant(write_archive(replace(PLAN, format=form), folder, InProcess()))
    assert not plant.problems
    return {task.tags.valve: recording_of(task) for task in make_plan(Request(plant=plant)).tasks}


def test_both_formats_hold_the_same(tmp_path: Path) -> None:
    """Every sample of every valve is the same from Parquet and from CSV, across midnight."""
    parquet, csv = written(tmp_path / "p", "parquet"), written(tmp_path / "c", "csv")
    assert list(parquet) == list(csv) == ["FV-00001", "FV-00002", "FV-00003"]
    for valve, item in parquet.items():
        other = csv[valve]
        assert (item.start, item.interval_s, len(item)) == (other.start, other.interval_s, 1800)
        assert item.start == PLAN.start
        for role in (Role.OP, Role.MV, Role.PV, Role.SP):
            assert np.array_equal(
                item.signals[role].values, other.signals[role].values, equal_nan=True
            )
    dates = sorted(path.name for path in (tmp_path / "p" / "parquet").iterdir())
    assert dates == ["date=2026-03-01", "date=2026-03-02"]


def test_the_truth_stands_beside_it(tmp_path: Path) -> None:
    """Each valve has its truth, and a loop that is used again is marked and no copy."""
    result = written(tmp_path, "parquet")
    truth = json.loads((tmp_path / "truth.json").read_text("utf-8"))["valves"]
    assert [(item["tag"], item["distinct"]) for item in truth] == [
        ("FV-00001", True),
        ("FV-00002", True),
        ("FV-00003", False),
    ]
    assert truth[0]["S"] == truth[2]["S"]
    assert not np.array_equal(result["FV-00001"].mv.values, result["FV-00003"].mv.values)
    assert np.array_equal(
        np.sort(result["FV-00001"].op.values), np.sort(result["FV-00003"].op.values)
    )


def test_a_loop_that_is_used_again_is_simulated_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two loops for two pieces of valves are two simulations, and nothing is left of them."""
    simulated = []

    def counted(*arguments: Any) -> Any:
        simulated.append(arguments)
        return simulate_loop(*arguments)

    monkeypatch.setattr("stemwatch.models.studies.simulator.simulate_loop", counted)
    write_archive(replace(PLAN, valves=PIECE + 3, hours=0.05), tmp_path, InProcess())
    assert len(simulated) == PLAN.distinct
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "parquet",
        "plant.toml",
        "truth.json",
    ]


def test_processes_write_the_same_archive(tmp_path: Path) -> None:
    """Files do not depend on who wrote them."""
    changed = replace(PLAN, valves=22, hours=0.05, distinct=0)
    for name, executor in (("one", InProcess()), ("two", LocalProcesses(2))):
        write_archive(changed, tmp_path / name, executor)
    files = sorted(path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("*.*"))
    assert len(files) == 4
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


@pytest.mark.parametrize("wrong", [{"valves": 0}, {"hours": 0.0}, {"interval_s": 0.0}])
def test_what_makes_no_archive_is_refused(wrong: dict[str, float]) -> None:
    """A plan without valves or samples is refused with what was received."""
    with pytest.raises(ValueError, match="received"):
        replace(PLAN, **wrong)


def test_the_command_writes_an_archive(stemwatch, tmp_path: Path) -> None:
    """``simulate-archive`` says where the archive is and that loops are used again."""
    outcome = stemwatch(
        "simulate-archive", tmp_path / "a", "--valves", 2, "--hours", 0.1, "--distinct", 1,
        "--workers", 1,
    )  # fmt: skip
    assert outcome.status == 0, outcome.said
    assert "Good for timing, not for counting verdicts" in outcome.said
    assert "plant.toml" in outcome.out
    assert load_plant(tmp_path / "a" / "plant.toml").valves.keys() == {"FV-00001", "FV-00002"}
