"""What keeps a verdict from being said, or changes it, beside S itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.decision.decide import decide
from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.terms._common import CALIBRATE_FROM_PERCENT
from stemwatch.models.record_checks.on_a_stop import Stop
from stemwatch.models.record_checks.own_swing import OwnSwing
from stemwatch.models.record_checks.pulsing_stem import Pulses
from stemwatch.models.record_checks.wandering_reading import Wander
from stemwatch.models.screening_result import Residual
from stemwatch.models.stickslip.change_of_stiction import ChangeOfStiction
from stemwatch.models.verdict import NoVerdict, Verdict
from tests.models.decision.test_decide import LIMITS, NO_FRICTION, POOR_FIT, evidence

STICKY, WATCH = LIMITS.sticky_S_percent, LIMITS.watch_S_percent


def at_least(bound):
    """S of which only a lower bound is known."""
    return Estimate(low=bound, unit="%", reason="the archive keeps averages")


def wander(percent):
    """A reading that wanders so far."""
    return Wander(course=np.zeros(3), percent=percent, period_s=600.0)


STOP = Stop(
    place=70.0, is_high=True, share=0.2, op_low=70.0, op_high=90.0, on=np.zeros(3, dtype=bool)
)
SMALL, SOME = {"S": 0.3, "half": 0.1}, {"S": 1.0, "half": 0.2}
NONE = Verdict.UNDETERMINED
CASES = [
    # S known by a lower bound alone
    ({"S_of": at_least(STICKY)}, Verdict.STICKY, None),
    ({"S_of": at_least(0.99 * STICKY)}, NONE, NoVerdict.S_UNCERTAIN),
    ({"S_of": at_least(STICKY), **NO_FRICTION}, NONE, NoVerdict.S_UNCERTAIN),
    # without its interval S proves nothing
    ({"S_of": Estimate(value=5.0, high=6.0, unit="%")}, NONE, NoVerdict.S_UNCERTAIN),
    ({"S_of": Estimate(value=5.0, low=4.0, unit="%")}, NONE, NoVerdict.S_UNCERTAIN),
    # S that changed within the recording, where another verdict holds before than after
    ({"changed": ChangeOfStiction(0.3, 5.0, 900.0)}, NONE, NoVerdict.S_CHANGED),
    ({"changed": ChangeOfStiction(5.0, 0.3, 900.0)}, NONE, NoVerdict.S_CHANGED),
    ({"changed": ChangeOfStiction(STICKY, 5.0, 900.0)}, Verdict.STICKY, None),
    (
        {**SMALL, "changed": ChangeOfStiction(0.2, 0.99 * WATCH, 900.0)},
        Verdict.HEALTHY,
        None,
    ),
    # a position that swings by itself
    ({**SMALL, "swings": OwnSwing(30.0, WATCH)}, NONE, NoVerdict.POSITION_SWINGS),
    ({**SMALL, "swings": OwnSwing(30.0, 0.99 * WATCH)}, Verdict.HEALTHY, None),
    ({"swings": OwnSwing(30.0, 5.0)}, Verdict.STICKY, None),
    # a stem that goes out and back by itself: beside a small S always, else if it is further
    ({**SMALL, "pulses": Pulses(4, 0.2)}, NONE, NoVerdict.POSITION_SWINGS),
    ({**SOME, "pulses": Pulses(4, 1.1)}, NONE, NoVerdict.POSITION_SWINGS),
    ({**SOME, "pulses": Pulses(4, 0.9)}, Verdict.WATCH, None),
    # a reading that wanders: a stroke check lets a little pass, and no wander rests and jumps
    ({**SMALL, "wander": wander(0.99 * CALIBRATE_FROM_PERCENT)}, Verdict.HEALTHY, None),
    ({**SMALL, "wander": wander(CALIBRATE_FROM_PERCENT)}, NONE, NoVerdict.READING_WANDERS),
    ({**SOME, "wander": wander(0.5)}, NONE, NoVerdict.READING_WANDERS),
    ({**SOME, "wander": wander(0.5), "jumps_evident": True}, Verdict.WATCH, None),
    ({**SOME, "wander": wander(0.5), "rests": True}, Verdict.WATCH, None),
    # a stem that stood on a stop sticks all the same, and else nothing is said
    ({"stop": STOP}, Verdict.STICKY, None),
    ({**SOME, "stop": STOP}, NONE, NoVerdict.STANDS_ON_A_STOP),
    ({**SMALL, "stop": STOP}, NONE, NoVerdict.STANDS_ON_A_STOP),
]


@pytest.mark.parametrize(("given", "verdict", "why"), CASES)
def test_verdict_beside_friction(given, verdict, why):
    """Each row of evidence ends in its verdict, or in the reason why there is none."""
    given = dict(given)
    estimate = given.pop("S_of", None)
    case = evidence(**given)
    decision = decide(case if estimate is None else replace(case, S=estimate), LIMITS)
    assert (decision.verdict, decision.no_verdict) == (verdict, why)
    assert "None" not in decision.reason


@pytest.mark.parametrize(
    ("rmse", "verdict"), [(0.59, Verdict.HEALTHY), (0.61, Verdict.UNDETERMINED)]
)
def test_a_lag_that_follows_within_three_times_the_noise_hides_no_friction(rmse, verdict):
    """What a lag leaves is then that of the readings."""
    following = Residual(rmse=rmse, normalised=0.2)
    case = evidence(**SMALL, without_lag=STICKY, following=following, sigma=0.2)
    assert decide(case, LIMITS).verdict is verdict


@pytest.mark.parametrize(
    ("normalised", "verdict"), [(0.79, Verdict.STICKY), (0.81, Verdict.UNDETERMINED)]
)
def test_a_fit_below_a_fifth_describes_no_valve(normalised, verdict):
    """Also where a network follows it no better, which is not named then."""
    residual = Residual(rmse=3.0, normalised=normalised)
    case = evidence(5.0, following=residual, narx=residual, **POOR_FIT)
    decision = decide(case, LIMITS)
    assert decision.verdict is verdict
    assert "network" not in decision.reason


@pytest.mark.parametrize(("hidden", "doubted"), [(STICKY, True), (0.99 * STICKY, False)])
def test_averages_that_may_hide_a_sticky_stem_halve_the_confidence(hidden, doubted):
    """The sentence says how much they may hide, and over how long they may be kept."""
    decision = decide(evidence(**SMALL, S_averaged=hidden, every_s=60.0), LIMITS)
    assert decision.verdict is Verdict.HEALTHY
    assert (decision.confidence <= 0.5) == doubted
    assert ("may hide an S of up to 1.5 %" in decision.reason) == doubted
    assert ("keeps averages" in decision.advice) == doubted
