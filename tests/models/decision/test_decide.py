"""From evidence to a verdict, and to sentences for a maintenance technician."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.decision.decide import decide
from stemwatch.models.decision.decision import shape_of
from stemwatch.models.decision.decision_evidence import DecisionEvidence
from stemwatch.models.decision.no_verdict import undetermined
from stemwatch.models.decision.reading_off import ReadingOff
from stemwatch.models.estimate import Estimate
from stemwatch.models.limits import Limits
from stemwatch.models.record_checks.data_quality import Obstacle
from stemwatch.models.screening_result import Residual
from stemwatch.models.stickslip.stored_range import StoredRange
from stemwatch.models.verdict import NoVerdict, Shape, Verdict

LIMITS = Limits()
GOOD_FIT = Residual(rmse=0.2, normalised=0.1)


def evidence(S=5.0, half=0.3, J=2.0, **changed) -> DecisionEvidence:
    """A clear case of S, with its interval, that the model follows well."""
    low, high = max(S - half, 0.0), S + half
    base = DecisionEvidence(
        S=Estimate(value=S, low=low, high=high, unit="%"),
        J=Estimate(value=J, low=0.9 * J, high=1.1 * J, unit="%"),
        S_draws=np.linspace(low, high, 300),
        friction_mean=1.0,
        friction_t=5.0,
        jumps_evident=False,
        following=GOOD_FIT,
        typical_percent=90.0,
        narx=None,
        unseen=None,
        sigma=0.03,
        slow="",
        baseline=None,
        baseline_ratio=None,
        cycling_s=None,
    )
    return replace(base, **changed)


MOVED = LIMITS.baseline_ratio_watch
FAR, NEAR = Residual(rmse=0.51, normalised=0.2), Residual(rmse=0.49, normalised=0.2)
POOR_FIT = {"typical_percent": 10.0, "friction_mean": 0.4, "friction_t": 3.0}
POOR = Residual(rmse=3.0, normalised=0.95)
POOR_RUN = Residual(rmse=1.1, normalised=1.1)
WORSE = Residual(rmse=3.0, normalised=1.05)  # than a constant
NO_FRICTION = {"friction_mean": 0.0, "friction_t": 0.0}
TABLE = [
    (evidence(5.0), Verdict.STICKY),
    (evidence(1.81, 0.3), Verdict.STICKY),  # the low end is just above the limit
    (evidence(1.79, 0.3), Verdict.WATCH),  # the low end is just below it
    (evidence(1.0, 0.2), Verdict.WATCH),
    (evidence(0.76, 0.1), Verdict.WATCH),  # S itself just above the lower limit
    (evidence(0.74, 0.1), Verdict.HEALTHY),
    (evidence(0.2, 0.1, J=0.0), Verdict.HEALTHY),
    (evidence(0.0, 0.1, J=0.0), Verdict.HEALTHY),
    (evidence(0.7, 0.9), Verdict.UNDETERMINED),  # small, but the high end is sticky
    (evidence(3.0, 2.9), Verdict.UNDETERMINED),  # anything between nothing and 6 %
    (evidence(5.0, **NO_FRICTION), Verdict.UNDETERMINED),  # a slow actuator fits as well
    (evidence(5.0, friction_t=1.9), Verdict.UNDETERMINED),
    (evidence(0.3, 0.1, **NO_FRICTION), Verdict.HEALTHY),
    (evidence(5.0, following=POOR, **POOR_FIT), Verdict.UNDETERMINED),
    (evidence(5.0, following=WORSE, typical_percent=10.0), Verdict.UNDETERMINED),
    (evidence(5.0, following=POOR, typical_percent=10.0), Verdict.STICKY),  # beyond doubt
    (evidence(5.0, following=POOR, **POOR_FIT | {"typical_percent": 70.0}), Verdict.STICKY),
    (evidence(0.2, following=POOR, **POOR_FIT), Verdict.UNDETERMINED),
    (evidence(5.0, following=None), Verdict.STICKY),
    (evidence(0.3, 0.1, baseline_ratio=0.99 * MOVED, baseline=FAR), Verdict.HEALTHY),
    (evidence(0.3, 0.1, baseline_ratio=1.01 * MOVED, baseline=FAR), Verdict.WATCH),
    (evidence(0.3, 0.1, baseline_ratio=9.0, baseline=NEAR), Verdict.HEALTHY),  # too small to matter
    (evidence(0.3, 0.1, baseline_ratio=9.0), Verdict.HEALTHY),
    (replace(evidence(), S=Estimate.unknown("no draws", unit="%")), Verdict.UNDETERMINED),
    (evidence(0.3, 0.1, unseen=Residual(rmse=0.7, normalised=0.61)), Verdict.UNDETERMINED),
    (evidence(0.3, 0.1, unseen=Residual(rmse=0.7, normalised=0.59)), Verdict.HEALTHY),
    (evidence(0.3, 0.1, unseen=Residual(rmse=0.49, normalised=1.2)), Verdict.HEALTHY),  # small
    (evidence(0.3, 0.1, sigma=0.4, unseen=POOR_RUN), Verdict.HEALTHY),  # hardly more than noise
    (evidence(5.0, unseen=POOR_RUN), Verdict.STICKY),  # slips come late: sticking is seen anyway
]
NARX = Residual(rmse=0.5, normalised=0.15)


@pytest.mark.parametrize(("case", "expected"), TABLE)
def test_verdict(case, expected):
    """Each row of evidence ends in its verdict."""
    assert expected is decide(case, LIMITS).verdict


@pytest.mark.parametrize(
    ("case", "cycling_s", "narx"),
    [(case, *more) for (case, _), more in itertools.product(TABLE, [(None, None), (61.7, NARX)])],
)
def test_sentences_and_numbers(case, cycling_s, narx):
    """Every judgement is readable and ranks within 0 to 100, whatever the evidence."""
    decision = decide(replace(case, cycling_s=cycling_s, narx=narx), LIMITS)
    for sentence in (decision.reason, decision.advice):
        assert sentence.endswith(".")
        assert not sentence.endswith("..")
        assert not any(word in sentence for word in ("None", "nan", "inf ", "?", "  "))
    assert 0.0 <= decision.severity <= 100.0
    assert (decision.confidence is None) == (decision.verdict is Verdict.UNDETERMINED)
    assert decision.confidence is None or 0.0 <= decision.confidence <= 1.0
    assert (decision.shape is not None) or decision.verdict is not Verdict.STICKY


def test_severity_ranks_the_verdicts():
    """Any sticky valve ranks above any watched one, and that above healthy and undetermined."""
    ranks: dict[Verdict, set[float]] = {verdict: set() for verdict in Verdict}
    for case, verdict in TABLE:
        ranks[verdict].add(decide(case, LIMITS).severity)
    assert min(ranks[Verdict.STICKY]) > max(ranks[Verdict.WATCH])
    assert min(ranks[Verdict.WATCH]) > max(ranks[Verdict.UNDETERMINED])
    assert min(ranks[Verdict.UNDETERMINED]) > max(ranks[Verdict.HEALTHY])


def test_worse_friction_ranks_higher():
    """Among sticky valves severity rises with S and with J."""
    assert decide(evidence(6.0), LIMITS).severity > decide(evidence(3.0), LIMITS).severity
    assert decide(evidence(5.0, J=4.0), LIMITS).severity > decide(evidence(5.0), LIMITS).severity


def test_sticky_says_how_much():
    """The reason of a sticky valve holds S, its interval, J and the loop's cycle."""
    decision = decide(evidence(5.0, 0.3, J=2.0, cycling_s=61.7), LIMITS)
    assert "OP must move 5.0 % (4.7 % to 5.3 %)" in decision.reason
    assert "then jumps 2.0 %" in decision.reason
    assert "cycles every 62 s" in decision.reason
    assert 0.99 == decision.confidence


def test_deadband_does_not_jump():
    """A stem that follows late without a jump is said to follow, and play is looked for first."""
    decision = decide(evidence(5.0, J=0.0), LIMITS)
    assert Shape.DEADBAND is decision.shape
    assert "and then follows" in decision.reason
    assert "jumps" not in decision.reason
    assert "play in the linkage" in decision.advice


def test_healthy_that_cycles_points_elsewhere():
    """A healthy valve in an oscillating loop sends the reader to tuning and disturbances."""
    decision = decide(evidence(0.2, 0.1, cycling_s=120.0), LIMITS)
    assert "oscillates nevertheless, every 2 min" in decision.reason
    assert "tuning" in decision.advice


def test_what_is_slow_is_said_beside_the_friction():
    """A slow actuator is one more sentence of the reason, whatever the verdict."""
    slow = " The actuator lags by 3 s."
    for S, half in ((5.0, 0.3), (1.0, 0.2), (0.2, 0.1)):
        assert decide(evidence(S, half, slow=slow), LIMITS).reason.endswith("." + slow)


def test_neural_network_that_follows_better_is_named():
    """Where a network follows and friction does not, the reason gives both shares."""
    case = evidence(5.0, following=POOR, narx=NARX, **POOR_FIT)
    reason = decide(case, LIMITS).reason
    assert "friction explains only 5 %" in reason
    assert "a neural network follows 85 %" in reason


def test_a_residual_within_noise_does_not_refute_the_model():
    """A residual within three times the position's noise is no reason to doubt S and J."""
    noisy = evidence(5.0, following=Residual(rmse=0.9, normalised=0.95), **POOR_FIT)
    assert Verdict.UNDETERMINED is decide(noisy, LIMITS).verdict
    assert Verdict.STICKY is decide(replace(noisy, sigma=0.31), LIMITS).verdict


@pytest.mark.parametrize(
    ("S", "J", "shape"),
    [
        (5.0, 0.0, Shape.DEADBAND),
        (5.0, 0.49, Shape.DEADBAND),
        (5.0, 0.51, Shape.UNDERSHOOT),
        (5.0, 4.2, Shape.UNDERSHOOT),
        (5.0, 4.3, Shape.NO_OFFSET),
        (5.0, 5.7, Shape.NO_OFFSET),
        (5.0, 5.8, Shape.OVERSHOOT),
        (0.0, 0.0, Shape.DEADBAND),
    ],
)
def test_shape_by_ratio(S, J, shape):
    """J/S names the shape of the OP-MV loop."""
    assert shape is shape_of(S, J)


def test_undetermined_says_the_first_obstacle_and_counts_the_rest():
    """The first obstacle is the reason, its remedy the advice, and the others are counted."""
    first = Obstacle(NoVerdict.OP_STILL, "OP did not move", "Step OP.")
    result = undetermined((first, Obstacle(NoVerdict.TOO_SHORT, "too short", "Wait.")))
    assert "Cannot tell: OP did not move (and 1 more, see data quality)." == result.reason
    assert "Step OP." == result.advice
    assert "Cannot tell: OP did not move." == undetermined((first,)).reason


def test_limits_of_the_plant_decide():
    """A plant that sets wider limits judges the same evidence more mildly."""
    wide = Limits(watch_S_percent=6.0, sticky_S_percent=8.0)
    assert Verdict.HEALTHY is decide(evidence(5.0), wide).verdict


@pytest.mark.parametrize(("S", "doubted"), [(0.05, False), (0.5, True)])
def test_a_healthy_valve_that_may_be_stored_in_milliamperes_is_not_sure(S, doubted):
    """Both stay within 4 to 20: healthy with doubt where S in milliamperes would be too large."""
    case = evidence(S, 0.05, J=0.0, both_in=StoredRange(4.0, 20.0, "mA"))
    decision = decide(case, LIMITS)
    assert decision.verdict is Verdict.HEALTHY
    assert decision.confidence is not None
    assert (decision.confidence < 0.8) == doubted
    assert ("if they are stored in mA, S is 3.1 %" in decision.reason) == doubted
    assert ("low = 4, high = 20" in decision.advice) == doubted


def test_what_an_archive_leaves_open_counts_in_milliamperes_too():
    """S may be 0.5 %, which is healthy, or 3.1 % if 4 to 20 is the range: that cannot be told."""
    open_to = {"sampling": "the archive stored lines to 0.3 %", "J": 0.0}
    stored = StoredRange(4.0, 20.0, "mA")
    decision = decide(evidence(0.1, 0.4, both_in=stored, **open_to), LIMITS)
    assert decision.verdict is Verdict.UNDETERMINED
    assert "0.5 % cannot be excluded" in decision.reason
    assert "stored in mA" in decision.reason
    assert decide(evidence(0.1, 0.4, **open_to), LIMITS).verdict is Verdict.HEALTHY


def test_some_friction_that_may_be_stored_in_milliamperes_is_not_sure():
    """Both stay within 4 to 20: an S of 1 % of percent would be a sticky 6.2 % of milliamperes."""
    decision = decide(evidence(1.0, 0.1, both_in=StoredRange(4.0, 20.0, "mA")), LIMITS)
    assert decision.verdict is Verdict.WATCH
    assert decision.confidence == 0.5
    assert "if they are stored in mA, S is 6.2 %" in decision.reason
    assert "low = 4, high = 20" in decision.advice
    assert decide(evidence(1.0, 0.1), LIMITS).confidence == 0.99


@pytest.mark.parametrize("S", [0.05, 0.5, 1.0, 2.5])
def test_an_op_alone_that_may_be_stored_in_milliamperes_is_told(S):
    """OP stays within 4 to 20, the position does not: where S in percent of the other range would
    change the verdict it is in doubt, and a sticking valve's S is given in that range too."""
    case = evidence(S, 0.05, J=0.0, op_in=StoredRange(4.0, 20.0, "mA"))
    decision, plain = decide(case, LIMITS), decide(evidence(S, 0.05, J=0.0), LIMITS)
    assert decision.verdict is plain.verdict
    told = S > 0.05
    expected = f"far from where the position is: if it is stored in mA, S is {6.25 * S:.1f} %"
    assert (expected in decision.reason) == told
    assert (
        "Check whether OP is in percent. If it is in mA, give low = 4" in decision.advice
    ) == told
    doubted = told and plain.verdict is not Verdict.STICKY
    assert decision.confidence == (0.5 if doubted else plain.confidence)


def test_limits_in_order():
    """A watch limit above the sticky one is refused with both numbers."""
    with pytest.raises(ValueError, match=r"received 2.0 and 1.0"):
        Limits(watch_S_percent=2.0, sticky_S_percent=1.0)


def test_evident_jumps_give_sticky_although_the_model_mistimes_slips():
    """A stem seen to rest and jump sticks, though the model misses the instants of its slips."""
    poor = {"following": POOR, **POOR_FIT}
    assert decide(evidence(4.0, 2.0, **poor), LIMITS).verdict is Verdict.UNDETERMINED
    assert decide(evidence(4.0, 2.0, jumps_evident=True, **poor), LIMITS).verdict is Verdict.STICKY


@pytest.mark.parametrize(("S", "verdict"), [(0.2, Verdict.HEALTHY), (1.0, Verdict.WATCH)])
def test_a_lead_of_the_position_halves_the_confidence(S, verdict):
    """Clocks or exchanged tags: the reason says so, and no verdict is sure."""
    decision = decide(evidence(S, 0.1, J=0.0, leads_s=3.0), LIMITS)
    assert (decision.verdict, decision.confidence) == (verdict, 0.5)
    assert "moves 3 s before OP" in decision.reason


@pytest.mark.parametrize(("takes_s", "slow"), [(0.0, False), (1.5, False), (10.0, True)])
@pytest.mark.parametrize("cycling_s", [None, 90.0])
def test_a_slow_stem_that_does_not_stick_is_worth_a_look(takes_s, slow, cycling_s):
    """It is healthy, and no longer said to need nothing where it takes longer than large valves."""
    decision = decide(evidence(0.1, 0.1, takes_s=takes_s, cycling_s=cycling_s), LIMITS)
    assert decision.verdict is Verdict.HEALTHY
    assert ("check the air supply" in decision.advice) is slow
    assert ("Nothing to do at the valve" in decision.advice) is (cycling_s is None and not slow)
    assert ("tuning" in decision.advice) is (cycling_s is not None)


@pytest.mark.parametrize("S", [1.0, 1.4, 5.0])
def test_where_another_curve_fits_as_well_no_friction_is_said(S):
    """What a curve from OP to stroke is off by looks like a dead band: neither watch nor sticky."""
    decision = decide(evidence(S, curve_is_enough=True), LIMITS)
    assert decision.verdict is Verdict.UNDETERMINED
    assert "a curve from OP to stroke" in decision.reason
    assert decide(evidence(S), LIMITS).verdict in (Verdict.WATCH, Verdict.STICKY)


@pytest.mark.parametrize(
    ("without_lag", "rmse", "sigma", "verdict"),
    [
        (4.8, 1.0, 0.1, Verdict.UNDETERMINED),
        (4.8, 0.4, 0.1, Verdict.HEALTHY),  # the lag follows the stem
        (4.8, 1.0, 0.4, Verdict.HEALTHY),  # to its noise
        (1.4, 1.0, 0.1, Verdict.HEALTHY),  # no sticking friction without the lag either
    ],
)
def test_a_lag_in_the_place_of_friction_must_follow_the_stem(without_lag, rmse, sigma, verdict):
    """A small S beside a lag is no proof of health where S alone would be sticking, and what was
    not fitted is followed neither way."""
    seen = evidence(0.1, 0.1, without_lag=without_lag, sigma=sigma)
    decision = decide(replace(seen, following=Residual(rmse=rmse, normalised=0.3)), LIMITS)
    assert decision.verdict is verdict
    if verdict is Verdict.UNDETERMINED:
        assert decision.no_verdict is NoVerdict.SLOW_ACTUATOR
        assert not decision.numbers_hold
        assert "S of 4.8 %" in decision.reason


def test_friction_that_looks_like_a_slow_actuator_is_neither_healthy_nor_watch():
    """Where OP may shake a sticking stem loose between its samples, there is no verdict unless S
    alone is sure."""
    for S in (0.1, 1.0):
        decision = decide(evidence(S, 0.1, shaken=2.0), LIMITS)
        assert decision.no_verdict is NoVerdict.SLOW_ACTUATOR
        assert not decision.numbers_hold
        assert "S of 2.0 %" in decision.reason
        assert decide(evidence(S, 0.1, shaken=1.4), LIMITS).verdict is not Verdict.UNDETERMINED
    assert decide(evidence(5.0, 0.1, shaken=5.0), LIMITS).verdict is Verdict.STICKY


def test_a_small_S_is_no_proof_of_health_where_noise_of_OP_hides_a_large_one():
    """Friction that is seen is told all the same."""
    decision = decide(evidence(0.1, 0.1, S_unseen=2.0), LIMITS)
    assert decision.no_verdict is NoVerdict.SLOW_SAMPLING
    assert not decision.numbers_hold
    assert "S of 2.0 %" in decision.reason
    assert decide(evidence(0.1, 0.1, S_unseen=1.4), LIMITS).verdict is Verdict.HEALTHY
    assert decide(evidence(1.0, 0.1, S_unseen=2.0), LIMITS).verdict is Verdict.WATCH
    assert decide(evidence(5.0, S_unseen=7.0), LIMITS).verdict is Verdict.STICKY


def test_a_stem_that_rests_in_a_dead_band_has_friction():
    """A dead band that the archive shows decides where a slow actuator fits as well."""
    assert decide(evidence(5.0, **NO_FRICTION), LIMITS).verdict is Verdict.UNDETERMINED
    assert decide(evidence(5.0, rests=True, **NO_FRICTION), LIMITS).verdict is Verdict.STICKY


def test_a_healthy_valve_whose_position_stands_beside_OP_is_told_so():
    """A reading 4.9 % high in a batch loop was healthy without a word."""
    off = ReadingOff(low=0.0, at_low=4.9, high=49.0, at_high=-1.0)
    decision = decide(evidence(0.3, 0.1, off=off), LIMITS)
    assert decision.verdict is Verdict.HEALTHY
    assert "4.9 % above OP at 0 %, and 1.0 % below it at 49 %" in decision.reason
    assert "correct zero and span" in decision.advice
    assert "Nothing to do at the packing." in decision.advice
    assert "Nothing to do at the valve." not in decision.advice


def test_a_stem_beside_which_something_acts_is_not_said_to_follow():
    """It followed, by its sentence, before a speed limit of 0.5 %/s and slips that overshoot."""
    slow = " Beside friction: Slips overshoot."
    decision = decide(evidence(0.3, 0.1, slow=slow), LIMITS)
    assert decision.verdict is Verdict.HEALTHY
    assert decision.reason.startswith("The stem hardly sticks: S is 0.3 %")
    assert "follows" not in decision.reason
    assert decide(evidence(0.3, 0.1), LIMITS).reason.startswith("The stem follows: S is")


def test_a_wide_interval_says_which_S_cannot_be_excluded():
    """A small S whose interval reaches to sticky is no likely value with a doubt beside it."""
    decision = decide(evidence(0.7, 0.9), LIMITS)
    assert "an S of 0.7 % fits best, but 1.6 % cannot be excluded" in decision.reason
    assert "probably" not in decision.reason
