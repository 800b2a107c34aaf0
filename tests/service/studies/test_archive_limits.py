"""The limits of a late clock and a slow archive, beside recordings that have neither."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stemwatch.models.mismatch import between_samples
from stemwatch.models.stickslip import clock_shift
from stemwatch.service.studies.archive_limits import ALL_LOOPS, ArchiveEvidence, limits

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
        "late clock, by the controller: left of that at once": clock_shift.LEFT_AT_ONCE,
        "late clock, by the stem: mean gain": clock_shift.LEAST_MEAN,
        "late clock, by the stem: t": clock_shift.LEAST_T,
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
    late = printed["limits"][:3]
    assert [(row["beyond"], row["of"]) for row in late] == [(2, 2), (2, 2), (2, 2)]


def test_every_recording_is_in_the_file(printed) -> None:
    """Five ways of a sticking valve, six of a healthy one, and two of other kinds of loops."""
    assert len(printed["recordings"]) == 13
    assert printed["seed"] == SEED


def shown(per_turn: float, S_apart: float, *, sticking: bool = True) -> ArchiveEvidence:
    """A valve of any kind of loop whose clear slips answer at once."""
    return ArchiveEvidence(
        ALL_LOOPS, sticking, 0.0, 0.0, 0.9, per_turn, 1.0, 3.0, S_apart, 0.0, 0.2, 50, 0.1
    )


def test_nulls_beyond_a_limit_are_counted() -> None:
    """Slips that contradict a fit though every second was kept: one of three in a loop that turns
    often enough to be believed; the fourth turns too seldom."""
    nulls = [shown(20.0, 0.15), shown(25.0, 0.02), shown(28.0, 0.05), shown(60.0, 0.3)]
    by_name = {limit.name: limit for limit in limits(nulls)}
    apart = by_name["slips against the fit: S"]
    assert (apart.nulls, apart.nulls_beyond, apart.worst, apart.holds) == (3, 1, 0.15, False)
    turns = by_name["slips against the fit: samples to a turn"]
    assert (turns.nulls, turns.nulls_beyond, turns.worst) == (2, 1, 20.0)
    assert by_name["slow archive: samples to a turn"].nulls == 0
