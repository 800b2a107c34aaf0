"""How the study records valves, and how it counts what was said of S."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.recording import Recording
from stemwatch.models.verdict import Verdict
from stemwatch.service.executors import InProcess
from stemwatch.service.studies import robustness
from stemwatch.service.studies.robustness import (
    StudiedValve,
    StudyAnswer,
    coverage,
    draw_valves,
    recorded,
    rows,
    run_robustness,
)

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


def test_rows_of_few_valves_leave_the_band_by_chance() -> None:
    """33 and 40 of 40 are no evidence of another share than 88 to 98 %, 30 of 40 are; a way without
    numbers counts as none. With 93 % each, a fifth of such ways hold in 35 or fewer or in all 40.
    """
    all_ways = coverage([33, 40, 30, 0], [40, 40, 40, 0])
    assert (all_ways.held, all_ways.of, all_ways.ways, all_ways.outside) == (103, 120, 3, 1)
    assert all_ways.by_chance == pytest.approx(3 * 0.2002, abs=1e-3)
    assert coverage([400], [400]).outside == 1


def test_where_no_valve_has_an_S_the_table_says_so(stemwatch, monkeypatch) -> None:
    """Not "nan": no S and no J."""
    monkeypatch.setattr(robustness, "run_robustness", lambda *_: [answer(None), answer(None)])
    text = stemwatch("robustness", "--valves", 2, "--seed", 8484, "--way", WAY).said
    assert "no S" in text
    assert "no J" in text
    assert "nan" not in text


def test_a_run_goes_on_from_what_is_kept_way_by_way(monkeypatch, tmp_path) -> None:
    """A second way is added to what was kept; what a stopped run left of a line is asked again."""
    asked: list[str] = []

    def said(valve: StudiedValve, recording: Recording, way: str) -> StudyAnswer:
        asked.append(way)
        return replace(answer(None, (4.8, 4.0, 5.5)), way=way, sticking=valve.sticking)

    def run(*ways: str) -> list[StudyAnswer]:
        asked.clear()
        return run_robustness(1, 8484, ways, InProcess(), lambda _: None, tmp_path)

    monkeypatch.setattr(robustness, "answered", said)
    first = run("as it is")
    assert asked == ["as it is"] * 2
    file = min(tmp_path.iterdir())
    file.write_text(file.read_text(encoding="utf-8")[:-20], encoding="utf-8")
    both = run("as it is", "position reversed")
    assert sorted(asked) == ["as it is", "position reversed", "position reversed"]
    assert [one for one in both if one.way == "as it is"] == first
    assert run("position reversed") == [one for one in both if one.way == "position reversed"]
    assert not asked
    assert [row.way for row in rows(both)] == ["as it is", "position reversed"]


def test_the_table_of_the_page_is_printed(stemwatch, monkeypatch) -> None:
    """As Markdown, with the columns that docs/robustness.md has."""
    given = [
        answer(None, (4.8, 4.0, 5.5)),
        replace(answer(None), sticking=False, verdict=Verdict.HEALTHY),
    ]
    monkeypatch.setattr(robustness, "run_robustness", lambda *_: given)
    text = stemwatch("robustness", "--valves", 1, "--seed", 8484, "--markdown").said
    assert "| the same recording ... | healthy: called sticky, undetermined |" in text
    assert f"| {WAY} | 0, 0 of 1 | 0 of 1 | 0.20 %, 1 of 1, 1.5 % | none |" in text
    assert "1 of 1 intervals of S hold (100.0%); in 0 of 1 ways" in text
