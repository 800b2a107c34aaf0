"""The limits of a late clock and a slow archive, beside recordings that have neither."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stemwatch.models.mismatch.measurement import between_samples
from stemwatch.models.stickslip import clock_shift
from stemwatch.service.studies.archive_limits import (
    ALL_LOOPS,
    SELDOM,
    ArchiveEvidence,
    limits,
)

CONSTANTS = {
    "late clock, by the controller: left of that at once": clock_shift.LEFT_AT_ONCE,
    "late clock, by the stem: mean gain": clock_shift.LEAST_MEAN,
    "late clock, by the stem: t": clock_shift.LEAST_T,
    "late clock, by the stem: samples": clock_shift.LEAST,
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
# What the command wrote on its default draw.
FILE = Path(__file__).parents[3] / "docs" / "figures" / "archive-limits.json"


@pytest.fixture(scope="module")
def kept() -> dict:
    """The file of the default draw."""
    return json.loads(FILE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def printed(stemwatch, tmp_path_factory, kept) -> dict:
    """What the command writes for the first sticking and the first healthy valve of that draw."""
    file: Path = tmp_path_factory.mktemp("limits") / "limits.json"
    options = ("--valves", 1, "--seed", kept["seed"], "--workers", 1, "--json", file)
    outcome = stemwatch("calibrate-archives", *options)
    assert outcome.status == 0
    assert "slow archive: samples to a turn" in outcome.said
    assert "Draw more valves: no null" in outcome.said
    return json.loads(file.read_text(encoding="utf-8"))


def test_the_limits_are_those_of_the_product(printed, kept) -> None:
    """Each row has the constant that is used, here and in the file."""
    for report in (printed, kept):
        assert {row["name"]: row["limit"] for row in report["limits"]} == CONSTANTS


def test_each_limit_is_met_by_nulls_and_let_few_of_them_pass(kept) -> None:
    """On the default draw: none holds for want of recordings that could pass it."""
    for row in kept["limits"]:
        assert row["nulls"] > 0, row["name"]
        assert row["holds"], row["name"]
        if row["needed"] is not None:
            beyond = row["limit"] - row["needed"] if row["above"] else row["needed"] - row["limit"]
            assert beyond > 0.0, row["name"]


def test_the_page_has_the_limits_of_the_file(kept) -> None:
    """Each limit with where it lies and where it must."""
    page = (FILE.parents[1] / "method.md").read_text(encoding="utf-8")
    for row in kept["limits"]:
        side = "at least" if row["above"] else "at most"
        needed, worst = ("-" if at is None else f"{at:.3g}" for at in (row["needed"], row["worst"]))
        assert f"| {row['name']} | {side} {row['limit']:g} | {needed} | {worst} |" in page


def test_the_file_is_what_the_command_writes(printed, kept) -> None:
    """The recordings of the valves that are drawn first, one by one."""
    of_first = [row for row in printed["recordings"] if row["way"] not in (ALL_LOOPS, SELDOM)]
    valves = [row for row in kept["recordings"] if row["way"] not in (ALL_LOOPS, SELDOM)]
    starts = [place for place, row in enumerate(valves) if row["way"] == "as it is"]
    first_healthy = next(place for place in starts if not valves[place]["sticking"])
    same = [*valves[: starts[1]], *valves[first_healthy : starts[starts.index(first_healthy) + 1]]]
    assert len(of_first) == len(same) == 29
    for found, written in zip(of_first, same, strict=True):
        assert found["way"] == written["way"]
        assert found["late_mean"] == pytest.approx(written["late_mean"], rel=1e-2, abs=1e-3)
        assert found["friction_mean"] == pytest.approx(written["friction_mean"], rel=1e-2, abs=1e-3)


def test_late_clocks_lie_beyond_their_limits(printed) -> None:
    """A valve whose OP is stored 5 s late, by the controller and by the stem."""
    late = printed["limits"][:4]
    assert [(row["beyond"], row["of"]) for row in late] == [(2, 2)] * 4


def shown(per_turn: float, S_apart: float, *, sticking: bool = True) -> ArchiveEvidence:
    """A valve of any kind of loop whose clear slips answer at once."""
    return ArchiveEvidence(
        ALL_LOOPS, sticking, 0.0, 0.0, 0.0, 0.9, per_turn, 1.0, 3.0, S_apart, 0.0, 0.2, 50, 0.1
    )


def test_nulls_beyond_a_limit_are_counted() -> None:
    """Slips that contradict a fit though every second was kept: one of three in a loop that turns
    often enough to be believed; the fourth turns too seldom."""
    nulls = [shown(20.0, 0.15), shown(25.0, 0.02), shown(28.0, 0.05), shown(60.0, 0.3)]
    by_name = {limit.name: limit for limit in limits(nulls)}
    apart = by_name["slips against the fit: S"]
    assert (apart.nulls, apart.nulls_beyond, apart.worst, apart.holds) == (3, 1, 0.15, False)
    assert (apart.all_nulls, apart.needed) == (4, 0.15)
    turns = by_name["slips against the fit: samples to a turn"]
    assert (turns.nulls, turns.nulls_beyond, turns.worst) == (2, 1, 20.0)
    assert by_name["slow archive: samples to a turn"].nulls == 0
    assert not by_name["slow archive: samples to a turn"].holds


def test_one_null_of_twenty_may_lie_beyond() -> None:
    """Of forty recordings two; the limit must then lie beyond the third."""
    nulls = [shown(20.0, 0.01 * place) for place in range(40)]
    by_name = {limit.name: limit for limit in limits(nulls)}
    apart = by_name["slips against the fit: S"]
    assert (apart.nulls, apart.all_nulls, apart.holds) == (40, 40, False)
    assert apart.needed == pytest.approx(0.37)
