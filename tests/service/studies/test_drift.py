"""``stemwatch drift``: what is followed, what is counted, and what is printed."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from stemwatch.models.limits import Limits
from stemwatch.models.studies.simulator import draw_healthy
from stemwatch.service.cli.drift import drift, show
from stemwatch.service.executors import InProcess
from stemwatch.service.studies.drift import (
    HEALTHY,
    WINDOWS,
    DriftBatch,
    Followed,
    ValveFate,
    alarms,
    areas,
    as_json,
    calibrated_limit,
    follow_batch,
    limits,
    run_drift,
    scores,
)

VALVES, SEED = 3, 5


@pytest.fixture(scope="module")
def followed() -> list[Followed]:
    """Three loops, each followed through three fates."""
    return run_drift(VALVES, SEED, InProcess(), lambda _: None)


def of(fate: ValveFate, *ratios: float | None, S: float = 0.3) -> Followed:
    """A valve with these ratios in its later windows."""
    return Followed(
        tag="FIC-1",
        story="healthy, quiet",
        fate=fate,
        operation=None,
        S_before=0.3,
        S=S,
        J=0.0,
        ratios=ratios,
    )


MADE = [
    of(ValveFate.UNCHANGED, 1.0, 1.1, 0.9),
    of(ValveFate.UNCHANGED, 1.2, 1.2, 1.2),
    of(ValveFate.OPERATED, 3.4, 3.4, 3.4),
    of(ValveFate.OPERATED, None, None, None),
    of(ValveFate.GROWING, 2.0, 2.2, 2.6, S=2.0),
    of(ValveFate.GROWING, 5.0, 6.0, 7.0, S=6.0),
    of(ValveFate.GROWING, 9.0, None, None, S=3.0),
]


def test_every_loop_is_followed_through_every_fate(followed: list[Followed]) -> None:
    """Three rows for each loop, each with a ratio or a refusal for each later window."""
    assert [fate for _ in range(VALVES) for fate in ValveFate] == [item.fate for item in followed]
    assert {WINDOWS} == {len(item.ratios) for item in followed}
    assert [loop.tag for loop in draw_healthy(VALVES, SEED) for _ in ValveFate] == [
        item.tag for item in followed
    ]


def test_only_growing_valves_grow(followed: list[Followed]) -> None:
    """A healthy valve keeps its S; a growing one ends where the product calls it sticking."""
    for item in followed:
        if item.fate in HEALTHY:
            assert item.S_before == item.S
        else:
            assert item.S_before < 1.0 < 1.49 < item.S <= 8.01
            assert 0.0 <= item.J <= item.S + 1e-9


def test_growing_stiction_raises_the_ratio_of_a_valve_that_is_worked(followed) -> None:
    """Same baseline, but the valve that grew is followed worse; a quiet loop need not show it."""
    worked = [item for item in followed if item.story != "healthy, quiet"]
    unchanged = [item.score for item in worked if item.fate is ValveFate.UNCHANGED]
    growing = [item.score for item in worked if item.fate is ValveFate.GROWING]
    assert len(unchanged) == len(growing) == 2
    assert 0.5 < max(unchanged) < 1.8 < min(growing)


def test_a_loop_is_the_same_alone_and_in_company(followed: list[Followed]) -> None:
    """Neither the batch nor the number of valves changes what is found."""
    place = 1
    (loop,) = draw_healthy(VALVES, SEED)[place : place + 1]
    alone = follow_batch(DriftBatch(loops=((place, loop),), seed=SEED, fates=tuple(ValveFate)))
    assert followed[place * len(ValveFate) : (place + 1) * len(ValveFate)] == alone


def test_progress_counts_loops_and_not_rows() -> None:
    """The caller hears of loops, whatever the number of fates."""
    answer: list[int] = []
    run_drift(1, SEED, InProcess(), answer.append, HEALTHY)
    assert [1] == answer


def test_a_loop_without_a_baseline_says_why() -> None:
    """A window too short to train on gives rows with the trainer's reason and no score."""
    loop = replace(draw_healthy(1, SEED)[0], duration_s=120.0)
    result = follow_batch(DriftBatch(loops=((0, loop),), seed=SEED, fates=(ValveFate.UNCHANGED,)))
    assert "too few usable samples" in result[0].reason
    assert result[0].score is None


@pytest.mark.parametrize(
    ("ratios", "score", "refused"),
    [
        ((9.0, 9.0, 9.0, 1.0, 3.0, 2.0), 2.0, 0),
        ((9.0, 1.0, None, 3.0, None, 2.0), 2.0, 2),
        ((1.0, None, 3.0), 2.0, 1),
        ((1.0, None, None), None, 2),
        ((), None, 0),
    ],
)
def test_the_score_is_the_median_of_the_last_three_scored_windows(ratios, score, refused) -> None:
    """Refused windows are passed over; one scored window is too few."""
    item = of(ValveFate.UNCHANGED, *ratios)
    assert (score, refused) == (item.score, item.refused)


def test_scores_leave_out_valves_that_have_none() -> None:
    """Two fates together, without the refused valve."""
    assert [1.0, 1.2, 3.4] == scores(MADE, *HEALTHY)


def test_without_healthy_scores_there_is_no_limit() -> None:
    """Nothing is made up where nothing was scored."""
    assert calibrated_limit([], 0.02) is None


def test_the_calibrated_limit_lets_two_in_a_hundred_through() -> None:
    """Of a hundred healthy valves at most two lie above, and a tenth lower more would."""
    healthy = [1.0 + index / 100 for index in range(100)]
    limit = calibrated_limit(healthy, 0.02)
    assert 2.0 == pytest.approx(limit)
    assert sum(score > limit for score in healthy) <= 2 < sum(s > limit - 0.1 for s in healthy)


def test_a_limit_on_a_whole_tenth_stays_there() -> None:
    """Rounding up does not push 1.3 to 1.4."""
    assert 1.3 == pytest.approx(calibrated_limit([1.3] * 10, 0.05))


def test_alarms_are_counted_for_each_group_and_size_of_stiction() -> None:
    """Scored valves by way and by S at the end; the refused ones count in the last row."""
    assert [
        ("unchanged", 0, 2),
        ("unchanged, run differently", 1, 1),
        ("growing stiction", 1, 2),
        ("growing, to S of 1.5 to 2.5 %", 0, 1),
        ("growing, to S of 2.5 to 4 %", 0, 0),
        ("growing, to S of 4 % and more", 1, 1),
        ("growing, with those refused", 1, 3),
    ] == alarms(MADE, 3.0)


def test_areas_compare_growing_with_each_kind_of_healthy_valve() -> None:
    """Against both, two of the six pairs are wrong or not, by hand."""
    result = areas(MADE)
    assert 1.0 == result["unchanged"].value
    assert 0.5 == result["unchanged, run differently"].value
    assert pytest.approx(5 / 6) == result["both"].value
    # Growing 0, 2.2, 6 against 0, 1, 1.2, 3.4: 0.5 + 3 + 4 of 12.
    assert pytest.approx(7.5 / 12) == result["both, a refusal being no alarm"].value


def test_limits_are_the_calibrated_ones_and_the_products() -> None:
    """The limit that verdicts use stands beside those found."""
    named = limits(MADE)
    assert 3.4 == pytest.approx(named["calibrated, 5%"]) == pytest.approx(named["calibrated, 2%"])
    assert Limits().baseline_ratio_watch == named["watch limit"]
    assert ["watch limit"] == list(limits([]))


def test_the_tables_say_what_was_found(capsys, monkeypatch) -> None:
    """Counts, areas, target and alarms; a valve without a baseline is named with the reason."""
    monkeypatch.setenv("COLUMNS", "160")
    show([*MADE, replace(of(ValveFate.UNCHANGED), reason="OP never moves")], MADE)
    text = " ".join(capsys.readouterr().out.split())
    for words in (
        "2 of 3",
        "against both: 0.833",
        "Target: 0.95 against both: missed.",
        "calibrated, 2%: 3.4",
        "1 of 3",
        "No baseline could be trained for 1 of 8 rows: OP never moves.",
    ):
        assert words in text


def test_the_json_can_be_counted_again() -> None:
    """Rows with their scores, and the alarms that they make."""
    written: dict[str, Any] = json.loads(json.dumps(as_json(MADE, MADE), allow_nan=False))
    assert [item.score for item in MADE] == [row["score"] for row in written["followed"]]
    watch = written["limits"]["watch limit"]
    (growing,) = [row for row in watch["alarms"] if row["of"] == "growing stiction"]
    counts = [r["score"] for r in written["followed"] if r["way"] == "growing stiction"]
    limit = Limits().baseline_ratio_watch
    assert growing["alarms"] == sum(score is not None and score > limit for score in counts)


@pytest.mark.long
def test_the_command_writes_its_json(tmp_path) -> None:
    """Two loops in this process: the file holds every row, the calibration is of another seed."""
    app = typer.Typer()
    app.command()(drift)
    file = tmp_path / "drift.json"
    result = CliRunner().invoke(
        app, ["--valves", "2", "--workers", "1", "--seed", "5", "--json", str(file)]
    )
    assert 0 == result.exit_code, result.output
    assert "AUC, growing against both" in result.output
    written = json.loads(file.read_text(encoding="utf-8"))
    assert (2, 5, 6, 4) == (
        written["valves"],
        written["seed"],
        len(written["followed"]),
        len(written["calibration"]),
    )
    tags = [{row["tag"] for row in written[part]} for part in ("followed", "calibration")]
    assert tags[0] != tags[1]
