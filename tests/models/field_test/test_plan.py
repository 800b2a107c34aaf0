"""The planned test: what it separates, when no test can, and that it keeps to its limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.closed_loop.process_response import ProcessResponse
from stemwatch.models.estimate import Estimate
from stemwatch.models.field_test.plan import FREE, STICKS, PlanKind, plan_test
from stemwatch.models.field_test.programme import MoveKind, TestLimits
from stemwatch.models.mismatch.open_question import OpenQuestion, RivalModel
from stemwatch.models.stickslip.stroke_curve import StrokeCurve


def model(slug: str, S: float = 2.0, J: float = 0.6, **terms: tuple[float, ...]) -> RivalModel:
    """A rival whose numbers are known well."""
    base = (S, J / S, 0.0, 0.0, 0.0, 0.0)
    return RivalModel(slug=slug, base=(base, base), terms={k: (v, v) for k, v in terms.items()})


def question(*models: RivalModel, **known: object) -> OpenQuestion:
    """The open question after an hour at 1 s, with OP at 47 %."""
    open_question = OpenQuestion(models=models, duration=3600.0, sigma=0.05, scatter=0.1, op=47.0)
    return replace(open_question, **known)


LAG = model("actuator_lag", actuator_lag=(4.0,))
DELAY = model("dead_time", dead_time=(4.0,))
DWELL = model("dwell_dependent_breakaway", dwell_dependent_breakaway=(0.6,))
ALONE = model("")
LEVEL = ProcessResponse(
    gain=Estimate(value=2.0, low=1.8, high=2.2), unit="t/h", pv_low=90.0, pv_high=110.0
)


def test_a_test_within_limits_separates_lag_and_dead_time():
    """A lag and a dead time of 4 s, which an hour did not separate, are separated in ten
    minutes.
    """
    plan = plan_test(question(LAG, DELAY))
    assert plan.kind is PlanKind.TELLS
    assert plan.test.probability >= 0.9
    assert plan.undecided == ()
    assert np.abs(plan.test.change).max() <= plan.limits.amplitude
    assert plan.test.programme.duration_s <= plan.limits.duration_s
    assert plan.test.change[0] == plan.test.change[-1] == 0.0
    assert plan.test.predicted.shape == (2, plan.test.change.size)


def test_same_question_gives_the_same_plan():
    """All draws are seeded."""
    first, second = (plan_test(question(LAG, DELAY)).test for _ in range(2))
    assert first.programme == second.programme
    assert np.array_equal(first.wins, second.wins)


def test_where_no_allowed_test_moves_the_valve_wider_limits_are_proposed():
    """With an S of 8 % the stem does not move within 3 % either way; twice the amplitude is
    proposed.
    """
    large = question(
        model("actuator_lag", S=8.0, J=3.0, actuator_lag=(4.0,)),
        model("dead_time", S=8.0, J=3.0, dead_time=(4.0,)),
    )
    plan = plan_test(large, TestLimits(amplitude=3.0))
    assert plan.kind is PlanKind.CANNOT_TELL
    assert plan.wider.amplitude > 3.0
    assert plan.wider_probability > 0.75
    wider = plan_test(large, plan.wider)
    assert wider.kind is PlanKind.TELLS


def test_dwell_needs_rests_for_which_a_minute_is_too_short():
    """No rest fits into a minute, so the test is refused with that reason."""
    plan = plan_test(question(ALONE, DWELL), TestLimits(duration_s=60.0))
    assert plan.kind is PlanKind.CANNOT_TELL
    assert "no move fits into 1 minute" in plan.reason


def test_growth_over_a_record_cannot_be_tested_in_minutes():
    """Half a percent in a day does not show in five minutes."""
    growth = model("growing_stiction", growing_stiction=(0.5,))
    plan = plan_test(question(ALONE, growth, duration=86400.0), TestLimits(duration_s=300.0))
    assert plan.kind is PlanKind.CANNOT_TELL
    assert plan.undecided == (("", "growing_stiction"),)


@pytest.mark.parametrize("models", [(), (LAG,)])
def test_without_rivals_there_is_no_test(models):
    """With one model or none there is no test."""
    plan = plan_test(question(*models))
    assert plan.kind is PlanKind.NOTHING_LEFT
    assert plan.test is None


def test_predicted_upset_of_pv_stays_within_the_limit():
    """A tighter limit gives a gentler test; a limit that no move keeps gives no test and a
    reason.
    """
    easy = question(LAG, DELAY, process=LEVEL)
    usual = plan_test(easy)
    assert usual.allowed_upset == pytest.approx(20.0)
    assert usual.test.upset <= 20.0
    tight = plan_test(easy, TestLimits(pv_upset=7.0))
    assert tight.test.upset <= 7.0
    none = plan_test(easy, TestLimits(pv_upset=0.05))
    assert none.kind is PlanKind.CANNOT_TELL
    assert none.test is None
    assert "upsets PV" in none.reason


def test_unknown_gain_of_pv_plans_without_an_upset():
    """Where the gain is not known the plan has no upset to show."""
    unknown = ProcessResponse(gain=Estimate.unknown("the valve explains only 3 % of what PV did"))
    plan = plan_test(question(LAG, DELAY, process=unknown))
    assert plan.kind is PlanKind.TELLS
    assert plan.test.upset is None


def test_valve_without_a_verdict_gets_the_bump_test_that_would_give_one():
    """Staircases separate a free stem from one that sticks."""
    plan = plan_test(question(), judged=False)
    assert plan.kind is PlanKind.BUMP
    assert plan.rivals == (FREE, STICKS)
    assert plan.test.probability >= 0.95
    assert {move.kind for move in plan.test.programme.moves} == {MoveKind.STAIRCASE}
    assert plan_test(None, judged=False).op_known is False


def test_op_near_its_end_goes_the_other_way_only():
    """At 95 % the test goes down only; without room either way it says so."""
    plan = plan_test(question(LAG, DELAY), op=95.0)
    assert plan.test.change.max() == 0.0
    assert plan.test.change.min() < 0.0
    no_room = plan_test(question(LAG, DELAY), TestLimits(op_low=94.9, op_high=95.0), op=95.0)
    assert "no room" in no_room.reason


def test_test_is_planned_through_the_curve_from_op_to_stroke():
    """On a split range a percent of OP is two of travel."""
    split = StrokeCurve(op=(0.0, 50.0), travel=(0.0, 100.0))
    plan = plan_test(question(LAG, DELAY, curve=split, op=25.0))
    assert plan.kind is PlanKind.TELLS
    assert plan.test.predicted.mean() == pytest.approx(50.0, abs=3.0)
    assert np.ptp(plan.test.predicted[0]) > 1.2 * np.ptp(plan.test.change)


def test_slow_archive_holds_each_value_for_some_samples():
    """With a sample every 30 s no value is held for less."""
    plan = plan_test(question(LAG, DELAY, unit_s=30.0, interval=1.0), TestLimits(duration_s=7200.0))
    assert all(move.hold_s >= 30.0 for move in plan.test.programme.moves)


def test_no_test_is_planned_for_growth_within_an_hour():
    """The two models differ in S at the beginning of the recording, which is long past: such a
    plan was once said to tell, and its test could not."""
    growth = model("growing_stiction", S=3.0, growing_stiction=(1.0,))
    alone = model("", S=4.5)
    hour = question(alone, growth, duration=3600.0)
    for minutes in (10.0, 60.0):
        plan = plan_test(hour, TestLimits(amplitude=10.0, duration_s=60.0 * minutes))
        assert (plan.kind, plan.test, plan.wider) == (PlanKind.CANNOT_TELL, None, None)
        assert plan.too_slow == ("growing_stiction",)
        assert plan.undecided == (("", "growing_stiction"),)


def test_slow_rivals_are_left_out_of_a_test_of_minutes():
    """Drift beside a lag and a dead time: these two are separated, but drift from neither."""
    drift = model("sensor_drift", sensor_drift=(2.0,))
    plan = plan_test(question(LAG, drift, DELAY))
    alone = plan_test(question(LAG, DELAY))
    assert (plan.kind, plan.rivals) == (PlanKind.TELLS, ("actuator_lag", "dead_time"))
    assert plan.too_slow == ("sensor_drift",)
    assert plan.undecided == (("actuator_lag", "sensor_drift"), ("sensor_drift", "dead_time"))
    assert plan.test.probability == alone.test.probability
