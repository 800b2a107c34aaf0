"""The study of mixed-up tags: what it changes, what it counts, and what it prints."""

from __future__ import annotations

import json

import numpy as np
import pytest

from stemwatch.models.recording import Role
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.verdict import Verdict
from stemwatch.service.executors import InProcess
from stemwatch.service.studies.miswiring import (
    AS_IT_IS,
    KINDS,
    RecordedValve,
    WiringAnswer,
    draw_miswired,
    record,
    rows,
    run_miswiring,
)


@pytest.fixture(scope="module")
def seen() -> RecordedValve:
    """A sticking valve with all that it can be mixed up with."""
    return record(draw_miswired(1, 5)[0])


def answer(sticking: bool, verdict: Verdict, confidence: float | None) -> WiringAnswer:
    return WiringAnswer("kind", "V", sticking, verdict, confidence, "why", "what", (), None)


def test_every_kind_changes_op_or_position_and_nothing_else(seen):
    """Each of more than thirty kinds gives another recording of the same length and clock."""
    assert len(KINDS) > 30
    for kind, change in KINDS.items():
        wired = change(seen)
        assert (len(wired), wired.interval_s) == (len(seen.recording), seen.recording.interval_s)
        same = all(
            np.array_equal(
                wired.signals[role].values, seen.recording.signals[role].values, equal_nan=True
            )
            for role in (Role.OP, Role.MV)
        )
        assert same == (kind == AS_IT_IS), kind


@pytest.mark.long
def test_valves_stick_and_do_not_in_turn_and_are_mixed_up_with_the_other_kind():
    """Half of the valves stick, from two draws, and none depends on how many there are."""
    drawn = draw_miswired(8, 5)
    assert [valve.sticking for valve in drawn] == [True, False] * 4
    assert [valve.name for valve in draw_miswired(4, 5)] == [valve.name for valve in drawn[:4]]
    assert len({valve.loop.tag for valve in drawn} | {valve.other_loop.tag for valve in drawn}) > 6


@pytest.mark.parametrize(
    ("seed", "number"), [(2098, 7), pytest.param(7171, 3, marks=pytest.mark.long)]
)
def test_a_position_a_minute_late_is_not_taken_for_a_large_S(seed, number):
    """In a loop that moves slowly a minute looks like an S of many percent, which explains seven
    tenths of the movement and more; OP of a minute ago explains nearly all of it. Before, the first
    of these healthy valves was called sticky with a confidence of 0.99.
    """
    (valve,) = draw_miswired(10, seed)[number : number + 1]
    late = KINDS["MV 60 s late"](record(valve))
    (one,) = screen([Case(recording=late)], Options(narx=False))
    assert not valve.sticking
    assert one.verdict is Verdict.UNDETERMINED
    assert "s after OP, later than a stem answers" in one.reason


@pytest.mark.parametrize(
    ("sticking", "verdict", "wrong"),
    [
        (False, Verdict.STICKY, True),
        (False, Verdict.WATCH, True),
        (False, Verdict.HEALTHY, False),
        (True, Verdict.HEALTHY, True),
        (True, Verdict.WATCH, False),
        (True, Verdict.UNDETERMINED, False),
    ],
)
def test_wrong_is_a_verdict_of_the_other_kind(sticking, verdict, wrong):
    """A healthy valve that is blamed, or a sticking one that is cleared."""
    assert answer(sticking, verdict, 0.9).wrong is wrong
    assert answer(sticking, verdict, 0.9).confidently_wrong is wrong
    assert not answer(sticking, verdict, 0.7).confidently_wrong


def test_a_row_counts_its_answers():
    """Wrong, undetermined and right add up to the valves of the row."""
    (row,) = rows(
        [
            answer(False, Verdict.STICKY, 0.7),
            answer(False, Verdict.STICKY, 0.9),
            answer(True, Verdict.UNDETERMINED, None),
            answer(True, Verdict.STICKY, 0.9),
        ]
    )
    assert (row.valves, row.confidently_wrong, row.wrong) == (4, 1, 2)
    assert (row.undetermined, row.right, row.highest, row.reason) == (1, 1, 0.9, "why")


def test_a_kind_that_is_not_known_is_an_error():
    """A misspelt kind is not a row of nothing."""
    with pytest.raises(KeyError, match="MV in furlongs"):
        run_miswiring(1, 5, ["MV in furlongs"], InProcess(), lambda _: None)


def test_the_command_counts_and_keeps_the_answers(stemwatch, tmp_path):
    """A row for each kind asked for, the total, and every answer in the JSON file."""
    file = tmp_path / "answers.json"
    outcome = stemwatch(
        "miswiring", "--loops", 1, "--seed", 5, "--kind", "MV frozen", "--workers", 1,
        "--json", file,
    )  # fmt: skip
    assert outcome.status == 0
    assert "MV frozen" in outcome.said
    assert "0 of 1 wrong" in outcome.said
    (kept,) = json.loads(file.read_text(encoding="utf-8"))
    assert (kept["kind"], kept["verdict"]) == ("MV frozen", "undetermined")
    assert stemwatch("miswiring", "--kind", "furlongs").status == 2
