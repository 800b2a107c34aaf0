"""Counts and lists as people say them."""

from __future__ import annotations

from stemwatch.models.words import capitalised, counted, listed


def test_one_of_a_thing_is_not_said_in_the_plural() -> None:
    """Nor does its verb."""
    assert [counted(n, "row") for n in (0, 1, 2)] == ["0 rows", "1 row", "2 rows"]
    said = [counted(n, "row was left out", "rows were left out") for n in (1, 2)]
    assert said == ["1 row was left out", "2 rows were left out"]


def test_a_long_list_says_how_many_more_there_are() -> None:
    """Names are left out only where there are more than asked for."""
    assert listed(["A", "B", "C"], 3) == "A, B, C"
    assert listed(["A", "B", "C"], 2) == "A, B and 1 more"
    assert listed([], 2) == ""


def test_a_sentence_may_begin_with_any_name() -> None:
    """What is large within it stays so."""
    assert capitalised("lag of MV") == "Lag of MV"
    assert capitalised("") == ""
