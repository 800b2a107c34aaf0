"""The recorded test: which rival it supports, when it cannot decide, and when no rival fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.field_test.judgement import (
    RULED_OUT,
    TestOutcome,
    judge_test,
)
from stemwatch.models.field_test.plan import plan_test
from stemwatch.models.field_test.programme import TestLimits
from stemwatch.models.recording import Quality, Recording, Role, Signal
from tests.models.field_test.simulated_test import simulated_test
from tests.models.field_test.test_plan import ALONE, DELAY, LAG, model, question

LIMITS = TestLimits(duration_s=300.0)


@pytest.fixture(scope="module")
def for_delays():
    """The programme that separates a lag from a dead time of 4 s, from OP at 47 %."""
    return plan_test(question(LAG, DELAY), LIMITS).test.programme


@pytest.mark.parametrize(
    ("hidden", "slug"),
    [({"lag_s": 4.0}, "actuator_lag"), ({"dead_time_s": 4.0}, "dead_time")],
)
def test_a_field_test_names_the_hidden_delay_and_rules_out_its_rival(for_delays, hidden, slug):
    """Whichever of the two the valve has, its test names it and rules the other out."""
    judgement = judge_test(question(LAG, DELAY), simulated_test(for_delays, 47.0, **hidden))
    assert judgement.outcome is TestOutcome.FOLLOWS
    assert judgement.winner == slug
    assert judgement.left == (slug,)
    assert judgement.as_far[judgement.best] == 1.0
    assert min(judgement.as_far) <= RULED_OUT


def test_same_recording_gives_the_same_judgement(for_delays):
    """All draws are seeded."""
    recording = simulated_test(for_delays, 47.0, lag_s=4.0)
    first, second = (judge_test(question(LAG, DELAY), recording) for _ in range(2))
    assert first.as_far == second.as_far
    assert first.leaves == second.leaves


def test_rivals_that_the_test_cannot_separate_are_not_ruled_out(for_delays):
    """A growth of half a percent in a day does not show in five minutes: neither rival is ruled
    out.
    """
    growth = model("growing_stiction", growing_stiction=(0.5,))
    slow = question(ALONE, growth, duration=86400.0)
    judgement = judge_test(slow, simulated_test(for_delays, 47.0))
    assert judgement.outcome is TestOutcome.CANNOT_TELL
    assert judgement.winner is None
    assert set(judgement.left) == {"", "growing_stiction"}


def test_valve_that_follows_no_rival_is_given_no_name(for_delays):
    """A stem that sticks four times as much as in either rival fits neither."""
    recording = simulated_test(for_delays, 47.0, S=8.0, J=4.0)
    judgement = judge_test(question(LAG, DELAY), recording)
    assert judgement.outcome is TestOutcome.NONE_FOLLOWS
    assert judgement.winner is None
    assert judgement.left == ()


def test_bad_samples_and_thinning_do_not_change_the_judgement(for_delays):
    """Unusable samples are bridged, and a long recording is thinned."""
    plain = simulated_test(for_delays, 47.0, dead_time_s=4.0)
    quality = np.array(plain.mv.quality)
    quality[40:52] = Quality.BAD
    values = np.array(plain.mv.values)
    values[40:52] = np.nan
    signals = {**plain.signals, Role.MV: replace(plain.mv, values=values, quality=quality)}
    assert judge_test(question(LAG, DELAY), replace(plain, signals=signals)).winner == "dead_time"
    rest = {
        role: Signal.good(np.append(signal.values, np.full(2500, signal.values[-1])), signal.tag)
        for role, signal in plain.signals.items()
        if role in (Role.OP, Role.MV)
    }
    judgement = judge_test(question(LAG, DELAY), replace(plain, signals=rest))
    assert judgement.interval_s == 2.0
    assert judgement.winner == "dead_time"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("no MV", "the position (MV) is not in the recording"),
        ("OP still", "OP moves by 0 % only: is this the recording of the test?"),
        ("few", "20 of 20 samples can be used; expected at least 30"),
        ("bad", "samples can be used"),
    ],
)
def test_a_recording_that_does_not_hold_the_test_is_refused_with_a_reason(
    for_delays, change, words
):
    """Nothing is raised; the reason says what was found and what was expected."""
    plain = simulated_test(for_delays, 47.0, lag_s=4.0)
    assert isinstance(plain, Recording)
    signals = dict(plain.signals)
    if change == "no MV":
        del signals[Role.MV]
    elif change == "OP still":
        signals[Role.OP] = Signal.good(np.full(len(plain), 47.0), "OP")
    elif change == "bad":
        bad = np.full(len(plain), Quality.BAD, dtype=np.uint8)
        signals[Role.MV] = replace(plain.mv, quality=bad)
    recording = replace(plain, signals=signals)
    recording = recording.part(0, 20) if change == "few" else recording
    judgement = judge_test(question(LAG, DELAY), recording)
    assert judgement.outcome is TestOutcome.NOT_TESTABLE
    assert words in judgement.reason
    assert judgement.fits == ()
