"""Records of milliseconds and of minutes on their whole way: from the export to the answer."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import pytest

import stemwatch as front_door

S, J = 5.0, 2.0
START = datetime(2026, 3, 2, 8, 0)


@dataclass(frozen=True)
class Export:
    """One file of a valve that sticks, and what its record should be called."""

    file: Path
    interval_s: float
    samples: int


@pytest.fixture(
    scope="module",
    params=[
        (0.001, 5000),
        pytest.param((0.01, 2000), marks=pytest.mark.long),
        pytest.param((60.0, 10080), marks=pytest.mark.long),
    ],
    ids=["5 s at 1 kHz", "20 s at 100 Hz", "a week at 60 s"],
)
def export(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Export:
    """The same loop as if it had run so much faster or slower, with time stamps to match."""
    interval_s, samples = request.param
    recording = front_door.simulate(S=S, J=J, minutes=samples / 60.0, seed=3)
    assert recording.mv is not None
    lines = ["Timestamp,FIC101.OP,FIC101.ZT"]
    for k, (op, mv) in enumerate(zip(recording.op.values, recording.mv.values, strict=True)):
        stamp = START + timedelta(seconds=k * interval_s)
        lines.append(f"{stamp.isoformat(sep=' ', timespec='milliseconds')}Z,{op:.4f},{mv:.4f}")
    file = tmp_path_factory.mktemp("intervals") / "fic101.csv"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return Export(file, interval_s, len(recording))


def test_screen_reads_and_judges_it(stemwatch, export: Export, tmp_path: Path) -> None:
    """Sticky, with S and J that hold the truth, over the time that the stamps say."""
    outcome = stemwatch("screen", export.file, "--out", tmp_path, "--workers", 1)
    assert outcome.status == 0
    (valve,) = json.loads((tmp_path / "valves.json").read_text("utf-8"))
    assert valve["verdict"] == "sticky"
    S_found, J_found = valve["stiction"]["S"], valve["stiction"]["J"]
    assert S_found["low"] <= S <= S_found["high"]
    assert J_found["low"] <= J <= J_found["high"]
    start, end = (datetime.fromisoformat(valve["window"][name]) for name in ("start", "end"))
    lasts_s = (export.samples - 1) * export.interval_s
    assert (end - start).total_seconds() == pytest.approx(lasts_s, abs=2 * export.interval_s)


def test_explain_reads_and_explains_it(stemwatch, export: Export, tmp_path: Path) -> None:
    """S alone holds the truth, and nothing is named that is not there."""
    results = tmp_path / "found.json"
    tags = ("--op", "FIC101.OP", "--mv", "FIC101.ZT")
    outcome = stemwatch("explain", export.file, *tags, "--json", results, "--no-narx")
    assert outcome.status == 0
    (explained,) = json.loads(results.read_text("utf-8"))
    assert explained["effects"] == []
    restated = explained["stiction"]["restated"]["S"]
    assert restated["low"] <= S <= restated["high"]
