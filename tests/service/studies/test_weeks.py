"""What windows of weeks confirm: counted, and through the real search in a tiny form."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.evidence_over_windows import WindowEvidence
from stemwatch.models.mismatch.findings import EffectScore
from stemwatch.models.studies.simulator.hidden import draw_effect, draw_nulls
from stemwatch.models.studies.simulator.hidden.draws import windows_of
from stemwatch.service.executors import InProcess
from stemwatch.service.studies import weeks
from stemwatch.service.studies.weeks import FollowedValve, count_over, follow, size_errors

BEGIN = datetime(2026, 1, 5, tzinfo=UTC)


def valve(hidden, *named, S=4.0):
    """A valve whose windows name an effect each, or nothing."""
    windows = []
    for day, slug in enumerate(named):
        at = BEGIN + timedelta(days=day)
        size = Estimate(value=4.1, low=3.9, high=4.3, unit="%")
        windows.append(
            WindowEvidence(
                at=at,
                start=at - timedelta(hours=1),
                named=((slug,),) if slug else (),
                scores=tuple(
                    EffectScore(slug=item, mean=0.0, t=0.0, strength=0.0)
                    for item in ("dead_time", "flow_force", "zero_shift")
                ),
                S=size,
                J=size,
            )
        )
    return FollowedValve(
        hidden=hidden,
        concealment="routine",
        S=S,
        J=S,
        testable=len(named),
        windows=tuple(windows),
    )


def test_false_alarms_are_valves_on_which_anything_was_ever_confirmed():
    """One that is gone again was false all the same; one window alone is none."""
    removed = valve((), "dead_time", "dead_time", *[""] * 8)
    once = valve((), "dead_time", *[""] * 9)
    counts = count_over([removed, once], 10)
    assert (counts.false, counts.nulls) == (1, 2)
    assert count_over([removed, once], 1).false == 0


def test_effects_are_counted_by_class_and_wrong_names_apart():
    """Found where one of the confirmed is right; every confirmed one is right or not."""
    right = valve(("flow_force",), "flow_force", "flow_force", "", "")
    wrong = valve(("flow_force",), "dead_time", "dead_time", "", "")
    missed = valve(("flow_force",), "", "", "", "flow_force")
    counts = count_over([right, wrong, missed], 4)
    assert (counts.found, counts.valves) == (1, 3)
    assert (counts.right, counts.named) == (1, 2)


def test_s_and_j_of_one_window_and_of_all_together():
    """Where an effect is confirmed; the truth 4.0 lies in both intervals."""
    item, together = size_errors([valve(("flow_force",), "flow_force", "flow_force", "flow_force")])
    assert (item.holds, item.of) == (6, 6)
    assert (together.holds, together.of) == (2, 2)
    assert together.median == pytest.approx(0.1)


def test_an_interval_that_ends_at_zero_holds_no_jump():
    """A stem that is said not to jump at all, and jumps: an upper end of 0 is an end."""
    followed = valve(("flow_force",), "flow_force", "flow_force", S=1.0)
    nothing = Estimate(value=0.0, low=0.0, high=0.0, unit="%")
    windows = tuple(replace(window, S=nothing, J=nothing) for window in followed.windows)
    single, together = size_errors([replace(followed, windows=windows)])
    assert (single.holds, single.of) == (0, 4)
    assert (together.holds, together.of) == (0, 2)


def test_later_windows_are_of_the_same_valve_moved_otherwise():
    """Nameplate, controller and hidden effects are those of the first; movements are its own."""
    (case,) = draw_effect("flow_force", 1, 5151)
    first, second, third = windows_of(case, 3)
    assert first is case
    assert second.loop.valve == case.loop.valve == third.loop.valve
    assert second.loop.controller == case.loop.controller
    assert len({window.loop.setpoints for window in (first, second, third)}) == 3
    assert windows_of(case, 2)[1] == second


def test_nothing_hidden_stays_nothing_in_later_windows():
    """By hand or by set points."""
    for case in draw_nulls(3, 5151):
        later = windows_of(case, 2)[1]
        assert later.loop == later.plain
        assert later.loop.valve == case.loop.valve


def test_a_study_that_was_stopped_goes_on_where_it_was(tmp_path, monkeypatch):
    """No window is explained twice, a line that was cut off is one that was not, and the counts are
    those of a study that was not stopped."""
    explained = []

    def say(case, day):
        explained.append(day)
        window = valve((), *["dead_time" if day == 1 else ""] * (day + 1)).windows[day]
        late = {("dead_time", "seconds"): Estimate(value=3.0, low=2.5, high=3.5, unit="s")}
        sizes = late if window.named else {}
        return replace(window, p_value=0.01, sizes=sizes), day != 2

    monkeypatch.setattr(weeks, "_explained", say)
    whole = follow(1, 4, 0, 4, 5151, InProcess(), keep=tmp_path)
    (file,) = tmp_path.iterdir()
    text = file.read_text()
    file.write_text(text[: text.rindex("{") + 9])
    explained.clear()
    assert follow(1, 4, 0, 4, 5151, InProcess(), keep=tmp_path) == whole
    assert explained == [3]
    assert follow(1, 4, 0, 4, 5151, InProcess(), keep=tmp_path) == whole
    assert explained == [3]
    assert file.read_text() == text
    fewer = follow(1, 2, 0, 4, 5151, InProcess(), keep=tmp_path)
    assert [len(one.windows) for one in fewer] == [2]
    assert whole[0].testable == 3


@pytest.mark.long
def test_a_late_command_is_confirmed_and_nothing_else(stemwatch):
    """Two valves over three windows each, one with nothing hidden."""
    followed = follow(1, 3, 1, 3, 7171, InProcess(), effects=("dead_time",))
    counts = count_over(followed, 3)
    assert (counts.false, counts.nulls) == (0, 1)
    assert (counts.found, counts.valves) == (1, 1)
    assert windows_of(draw_nulls(1, 5151)[0], 2)[1].simulated().recording.mv is not None
    outcome = stemwatch(
        "prove-weeks", "--nulls", 1, "--days", 2, "--valves", 0, "--seed", 5151, "--workers", 1
    )
    assert outcome.status == 0, outcome.said
    assert "0 of 1 false" in outcome.said


def test_an_unknown_effect_is_wrong_usage(stemwatch):
    """With those there are."""
    outcome = stemwatch("prove-weeks", "--effect", "rust")
    assert outcome.status == 2
    assert "flow_force" in outcome.said
