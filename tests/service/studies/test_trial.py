"""The blind trial: honest counts with honest intervals."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.studies.simulator import draw_healthy, draw_sticky
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.executors import InProcess
from stemwatch.service.studies.detection_rates import wilson
from stemwatch.service.studies.trial import (
    Marked,
    TrialBatch,
    accuracy,
    mark_batch,
    rates,
    run_trial,
    shapes,
)

pytestmark = pytest.mark.long  # a study: it simulates, fits and trains from the beginning


@pytest.fixture(scope="module")
def marked() -> list[Marked]:
    """Four healthy and two sticking valves, simulated and marked."""
    return run_trial(4, 3, InProcess(), lambda _: None, narx=False)


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory, stemwatch):
    """``stemwatch trial`` of four healthy and two sticking valves, with its JSON."""
    file = tmp_path_factory.mktemp("trial") / "marks.json"
    outcome = stemwatch("trial", "--loops", 4, "--no-narx", "--workers", 1, "--json", file)
    return outcome, json.loads(file.read_text(encoding="utf-8"))


def test_the_command_prints_its_table(printed) -> None:
    """Counts, shares and intervals are printed for all healthy, all sticking and each story."""
    outcome, _ = printed
    assert outcome.status == 0
    for words in ("all healthy", "all sticking", "of 4", "of 2", "95 % interval", "s a valve"):
        assert words in outcome.said
    assert "S: median error" in outcome.said


def test_the_json_holds_every_loop_with_truth_and_verdict(printed) -> None:
    """What was printed can be counted again from the file."""
    outcome, marks = printed
    assert 6 == len(marks)
    assert 4 == sum(mark["truth"]["healthy"] for mark in marks)
    called = sum(m["verdict"] == "sticky" for m in marks if not m["truth"]["healthy"])
    assert f"all sticking sticky {called} of 2" in outcome.said


def test_no_healthy_valve_is_called_sticky(printed) -> None:
    """In this small draw the count that matters most is nought."""
    _, marks = printed
    assert [] == [m["truth"] for m in marks if m["truth"]["healthy"] and m["verdict"] == "sticky"]


def test_a_seed_that_intervals_were_calibrated_with_is_said(stemwatch) -> None:
    """Whoever takes seed 11 is told that this is no blind count."""
    outcome = stemwatch("trial", "--loops", 2, "--seed", 11, "--no-narx", "--workers", 1)
    assert outcome.status == 0
    assert "these are not blind" in outcome.err


def test_the_same_seed_gives_the_same_marks(marked: list[Marked]) -> None:
    """A trial can be repeated, timings aside."""
    repeated = run_trial(4, 3, InProcess(), lambda _: None, narx=False)
    assert [replace(m, seconds=0.0) for m in marked] == [replace(m, seconds=0.0) for m in repeated]


def test_the_batch_of_a_valve_changes_no_mark(marked: list[Marked]) -> None:
    """A valve is marked alike alone and among others, and the truth is the drawn one."""
    drawn = [*draw_healthy(4, 3), *draw_sticky(2, 3)]
    (alone,) = mark_batch(TrialBatch(loops=((drawn[4], 3004),), narx=False))
    assert replace(marked[4], seconds=0.0) == replace(alone, seconds=0.0)
    assert not alone.truth.healthy


def test_progress_tells_how_many_are_done() -> None:
    """The caller hears of every batch, at the end of all loops."""
    answer: list[int] = []
    run_trial(2, 5, InProcess(), answer.append, narx=False)
    assert answer == [3]


def test_rates_count_each_valve_in_its_groups(marked: list[Marked]) -> None:
    """The verdicts of a group add up to the group, for all healthy, all sticking and each story."""
    counts = list(rates(marked))
    for name, size in (("all healthy", 4), ("all sticking", 2)):
        group = [(count, of) for group, _, count, of in counts if group == name]
        assert size == sum(count for count, _ in group)
        assert {size} == {of for _, of in group}
    stories = sum(count for group, _, count, _ in counts if not group.startswith("all "))
    assert stories == len(marked)


def test_accuracy_counts_sticking_valves_with_a_number(marked: list[Marked]) -> None:
    """Errors are of sticking valves only; an interval holds a truth that lies in it."""
    sticky = next(m for m in marked if not m.truth.healthy)
    truth = sticky.truth.S
    right = replace(sticky, verdict=Verdict.STICKY, S=(truth + 0.5, truth - 1, truth + 1), J=None)
    wrong = replace(right, S=(truth + 1.5, truth + 1, truth + 2))
    healthy = next(m for m in marked if m.truth.healthy)
    S, J = accuracy([right, wrong, healthy])
    assert ("S", 1, 2) == (S.name, S.within, S.of)
    assert S.median_error == pytest.approx(1.0)
    assert ("J", 0) == (J.name, J.of)


@pytest.mark.parametrize(
    ("hits", "of", "low", "high"),
    [
        (0, 10, 0.0, 0.2775),
        (5, 10, 0.2366, 0.7634),
        (10, 10, 0.7225, 1.0),
        (1, 240, 0.0007, 0.0232),
    ],
)
def test_wilson_intervals_are_the_published_ones(hits, of, low, high) -> None:
    """The score interval of Wilson (1927), to four digits."""
    assert (low, high) == pytest.approx(wilson(hits, of), abs=6e-5)


@given(of=st.integers(0, 5000), data=st.data())
@settings(max_examples=50, deadline=None)
def test_wilson_holds_the_share(of: int, data: st.DataObject) -> None:
    """Whatever was counted, the interval lies in [0, 1] and holds the share that was seen."""
    hits = data.draw(st.integers(0, of))
    low, high = wilson(hits, of)
    assert 0.0 <= low <= high <= 1.0
    if of:
        assert low - 1e-12 <= hits / of <= high + 1e-12


def test_shapes_are_counted_by_the_true_one(marked: list[Marked]) -> None:
    """A sticking valve counts under its own shape; one without a named shape does not count."""
    sticky = next(m for m in marked if not m.truth.healthy)
    own = sticky.truth.shape
    assert own is not None
    other = next(shape for shape in Shape if shape is not own)
    seen = [replace(sticky, shape=name) for name in (own.value, other.value, None)]
    assert (own.value, 1, 2) in shapes(seen)
    assert (other.value, 0, 0) in shapes(seen)
