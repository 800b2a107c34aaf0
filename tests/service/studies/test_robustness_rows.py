"""How the study records valves, and how it counts what was said of S."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.verdict import Verdict
from stemwatch.service.studies import robustness
from stemwatch.service.studies.robustness import StudyAnswer, draw_valves, recorded, rows

WAY = "8 hours, stored every 60 s"


def test_eight_hours_have_the_moves_of_the_first_in_each() -> None:
    """The set point of the first hour comes again; an hour alone is as it was."""
    valve = draw_valves(1, 8484)[1]
    item, eight = recorded(valve), recorded(valve, 8)
    assert len(eight) == pytest.approx(8 * len(item), abs=8)
    set_point = next(values for role, values in eight.signals.items() if role.value == "sp").values
    hour = len(item)
    start = next(values for role, values in item.signals.items() if role.value == "sp").values
    assert np.array_equal(set_point[:hour], start)
    last = round(max(at for at, _ in valve.case.loop.setpoints)) + 5
    assert set_point[hour + last] == set_point[last]


def answer(at_least: float | None, S: tuple[float, float, float] | None = None) -> StudyAnswer:
    return StudyAnswer(
        way=WAY,
        sticking=True,
        verdict=Verdict.STICKY,
        reason="",
        S=S,
        J=None,
        S_at_least=at_least,
        true_S=5.0,
        true_J=2.0,
        named=(),
        seconds=1.0,
    )


def test_a_bound_of_S_holds_where_S_is_not_below_it() -> None:
    """Of two bounds one holds; a valve with S itself has none."""
    (row,) = rows([answer(4.0), answer(5.5), answer(None, (4.8, 4.0, 5.5))])
    assert (row.S_at_least, row.at_least_held) == (2, 1)
    assert (row.with_numbers, row.S_held) == (1, 1)


def test_where_no_valve_has_an_S_the_table_says_so(stemwatch, monkeypatch) -> None:
    """Not "nan": no S and no J."""
    monkeypatch.setattr(robustness, "run_robustness", lambda *_: [answer(None), answer(None)])
    text = stemwatch("robustness", "--valves", 2, "--seed", 8484, "--way", WAY).said
    assert "no S" in text
    assert "no J" in text
    assert "nan" not in text
