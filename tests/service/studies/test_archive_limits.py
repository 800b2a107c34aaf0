"""The limits of a late clock and a slow archive, beside recordings that have neither."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stemwatch.models.mismatch import between_samples
from stemwatch.models.stickslip import clock_shift

SEED = 8484


@pytest.fixture(scope="module")
def printed(stemwatch, tmp_path_factory) -> dict:
    """What the command writes for one sticking and one healthy valve."""
    file: Path = tmp_path_factory.mktemp("limits") / "limits.json"
    options = ("--valves", 1, "--seed", SEED, "--workers", 1, "--json", file)
    outcome = stemwatch("calibrate-archives", *options)
    assert outcome.status == 0
    assert "slow archive: samples to a turn" in outcome.said
    return json.loads(file.read_text(encoding="utf-8"))


def test_the_limits_are_those_of_the_product(printed) -> None:
    """Each row has the constant that is used."""
    assert {row["name"]: row["limit"] for row in printed["limits"]} == {
        "late clock: mean gain": clock_shift.LEAST_MEAN,
        "late clock: t": clock_shift.LEAST_T,
        "slow archive: samples to a turn": between_samples.FEW,
        "friction evident: mean": between_samples.EVIDENT_MEAN,
        "friction evident: t": between_samples.EVIDENT_T,
        "slips against the fit: S": between_samples.S_APART,
        "slips against the fit: J": between_samples.J_APART,
        "slips against the fit: answered": between_samples.ANSWERED,
        "slips against the fit: jump": between_samples.CLEAR,
        "slips against the fit: bounds": between_samples.WIDEST,
        "slips against the fit: samples to a turn": between_samples.RESOLVED,
    }


def test_no_null_lies_beyond_a_limit_and_late_clocks_do(printed) -> None:
    """A valve kept every second by one clock is neither late nor slow; stored 5 s late it is."""
    assert all(row["holds"] for row in printed["limits"])
    late = printed["limits"][:2]
    assert [(row["beyond"], row["of"]) for row in late] == [(2, 2), (2, 2)]


def test_every_recording_is_in_the_file(printed) -> None:
    """Five ways of a sticking valve, six of a healthy one."""
    assert len(printed["recordings"]) == 11
    assert printed["seed"] == SEED
