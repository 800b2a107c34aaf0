"""A run compares its loops: what oscillates together stands in its report."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

START = datetime(2026, 3, 2, tzinfo=UTC)
NAMES = ("FIC101", "FIC102", "TIC103", "LIC104")


def write_export(path: Path, start: datetime) -> None:
    """Three and a half hours of four loops, three of which share a wave."""
    n = 1200
    rng = np.random.default_rng(3)
    phase = 2.0 * np.pi * np.arange(n) / 40.0 + 0.03 * np.cumsum(rng.normal(size=n))
    pv = 50.0 + rng.normal(size=(4, n))
    pv[:3] += 5.0 * np.sin(phase + np.array([[0.0], [1.0], [2.0]]))
    op = 50.0 - 0.5 * (pv - 50.0)
    rows = ["Time;" + ";".join(f"{name}.OP;{name}.PV" for name in NAMES)]
    for k in range(n):
        cells = (f"{op[i, k]:.3f};{pv[i, k]:.3f}" for i in range(4))
        at = start + timedelta(seconds=10 * k)
        rows.append(f"{at.isoformat()};" + ";".join(cells))
    path.write_text("\n".join(rows) + "\n")


def test_a_run_over_loops_without_position_finds_their_group(stemwatch, tmp_path: Path) -> None:
    """Three of four loops share a wave; none has a position, none gets a verdict or work. The next
    day's run knows the group again."""
    out = tmp_path / "report"
    for day in (0, 1):
        write_export(tmp_path / f"{day}.csv", START + timedelta(days=day))
        requested = ("screen", tmp_path / f"{day}.csv", "--db", f"sqlite:///{tmp_path / 'kept.db'}")
        run = stemwatch(*requested, "--out", out, "--workers", "1")
        assert run.status == 0
        assert "3 loops oscillate together every 6.7 min" in " ".join(run.out.split())
    results = {load["valve"]: load for load in json.loads((out / "valves.json").read_text())}
    assert results["LIC104"]["oscillates_with"] == []
    for name in NAMES[:3]:
        (group,) = results[name]["oscillates_with"]
        assert sorted(group["loops"]) == sorted(NAMES[:3])
        assert abs(group["period_s"] - 400.0) < 20.0
        assert (group["windows"], group["first_found"]) == (2, START.isoformat())
        assert results[name]["verdict"] == "undetermined"
    page = (out / "report.html").read_text()
    assert "Loops that oscillate together" in page
    assert page.index('href="#groups"') < page.index('id="groups"') < page.index("ranking-table")
    assert page.count("3 loops oscillate together every 6.7 min") == 2  # in the first lines, too
    assert "It was found in 2 windows so far." in page
