"""The same samples give the same result at any interval; results are in true units of time."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.decision.shaken_loose import LIKE_A_SHAKEN_BAND, SLOW_ARCHIVE_S
from stemwatch.models.estimate import Estimate
from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.preparation.own_clock import (
    SpokenEstimate,
    duration,
    estimate_in_seconds,
    off_own_clock,
    on_own_clock,
    parts_of_time,
    rate,
    seconds_of,
)
from stemwatch.models.record_checks.quality import assess
from stemwatch.models.recording import ClockFacts, Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator.hidden import draw_effect

FACTORS = (0.001, 0.01, 5.0, 60.0)
FAST, SLOW = FACTORS[0], FACTORS[-1]  # of which the short run tries one in each test
QUICK = Options(narx=False)
HIDDEN = ("dead_time", "rate_limit")
# A lag of 1.4 s times 60, and a speed limit of 1.5 %/s divided by 5 and 60.
SLOWER_THAN_BUILT = [("dead_time", 60.0), ("rate_limit", 5.0), ("rate_limit", 60.0)]


@cache
def lasting(slug):
    """An hour at 1 s of a loop with one effect hidden in it."""
    return draw_effect(slug, 1, 4001)[0].simulated().recording


def slower(recording, factor):
    """The same samples, ``factor`` times as far apart."""
    return replace(recording, interval_s=factor * recording.interval_s)


@cache
def screened(slug, factor):
    return screen([Case(recording=slower(lasting(slug), factor))], QUICK)[0]


@cache
def with_network(factor):
    case = Case(recording=slower(lasting("dead_time"), factor))
    return screen([case], Options(mismatch=False))[0]


@cache
def explained(slug, factor):
    return explain(slower(lasting(slug), factor))


def close(result, expected):
    assert result == pytest.approx(expected, rel=1e-9)


def same_but_for_time(result, expected, factor):
    """Names, S and J to the bit; what has a time in it scaled."""
    assert [item.slug for item in expected.effects] == [item.slug for item in result.effects]
    assert expected.finding is result.finding
    for stiction in ("naive", "restated"):
        assert getattr(expected, stiction) == getattr(result, stiction)
    for before, after in zip(expected.effects, result.effects, strict=True):
        assert before.evidence == after.evidence
        for name, item in before.parameters.items():
            power = {"s": 1, "%/s": -1, "rad/s": -1}.get(item.unit, 0)
            close(after.parameters[name].value, factor**power * item.value)
            close(after.parameters[name].low, factor**power * item.low)
            close(after.parameters[name].high, factor**power * item.high)
    # What is slower than any actuator is asked in true seconds, of archives that are slow.
    of_slow_archives = LIKE_A_SHAKEN_BAND if factor >= SLOW_ARCHIVE_S else ()
    refused = [
        [item.slug for item in answer.not_testable if item.slug not in of_slow_archives]
        for answer in (expected, result)
    ]
    assert refused[0] == refused[1]


@pytest.mark.long
@pytest.mark.parametrize(
    ("slug", "factor"),
    [(slug, f) for slug in HIDDEN for f in FACTORS if (slug, f) not in SLOWER_THAN_BUILT],
)
def test_a_screening_does_not_depend_on_how_long_a_second_is(slug, factor):
    """Verdict, S, J and names to the bit; times and speeds scale with the interval."""
    plain, other = screened(slug, 1.0), screened(slug, factor)
    assert plain.mismatch.effects
    assert (plain.verdict, plain.S, plain.J, plain.shape) == (
        other.verdict,
        other.S,
        other.J,
        other.shape,
    )
    assert (plain.severity, plain.confidence) == (other.severity, other.confidence)
    assert plain.residuals == other.residuals
    same_but_for_time(other.mismatch, plain.mismatch, factor)
    for name, indicator in plain.indicators.items():
        power = {"s": 1, "%/s": -1, "1/h": -1, "%/h": -1}.get(indicator.unit, 0)
        close(other.indicators[name].value, factor**power * indicator.value)


@pytest.mark.long
@pytest.mark.parametrize(("slug", "factor"), SLOWER_THAN_BUILT)
def test_an_actuator_slower_than_any_is_built_is_friction_beside_a_dead_band(slug, factor):
    """True seconds count there: S and verdict are those of the same samples closer together."""
    plain, other = screened(slug, 1.0), screened(slug, factor)
    assert plain.verdict is other.verdict
    assert not {effect.slug for effect in other.mismatch.effects} & set(LIKE_A_SHAKEN_BAND)
    assert other.S.low < plain.S.value < other.S.high


@pytest.mark.long
@pytest.mark.parametrize("factor", FACTORS)
def test_an_explanation_does_not_depend_on_how_long_a_second_is(factor):
    """``explain`` on its own, as ``screen``."""
    same_but_for_time(explained("dead_time", factor), explained("dead_time", 1.0), factor)


@pytest.mark.parametrize(
    ("factor", "answer"),
    [
        (0.001, "ms after its command"),
        pytest.param(0.01, "ms after its command", marks=pytest.mark.long),
        pytest.param(60.0, "min after its", marks=pytest.mark.long),
    ],
)
def test_a_sentence_says_a_time_in_a_unit_that_suits_the_recording(factor, answer):
    """Milliseconds on a fast record, minutes on a slow one."""
    (effect, *_) = screened("dead_time", factor).mismatch.effects
    assert answer in effect.sentence
    assert answer in screened("dead_time", factor).reason


def test_a_result_keeps_its_recording_in_seconds():
    """The own clock is used inside the models only."""
    result = screened("dead_time", FAST)
    assert result.recording.own_unit_s is None
    assert FAST == result.recording.interval_s == result.seen.interval_s


@pytest.mark.long
@pytest.mark.parametrize("factor", [0.01, pytest.param(60.0, marks=pytest.mark.long)])
def test_a_network_is_kept_in_seconds_and_follows_a_later_window(factor):
    """Its actuator's times scale, and it follows as well as it does at 1 s."""
    plain, scaled = with_network(1.0), with_network(factor)
    assert scaled.network.interval_s == pytest.approx(factor)
    for name, value in plain.network.actuator.items():
        close(scaled.network.actuator[name], factor * value)
    cases = [
        Case(recording=slower(lasting("dead_time"), item), baseline=network)
        for item, network in ((1.0, plain.network), (factor, scaled.network))
    ]
    later = screen(cases, Options(narx=False, mismatch=False))
    ratios = [result.indicators["baseline_ratio"].value for result in later]
    close(ratios[1], ratios[0])


def test_a_recording_of_a_second_a_sample_is_on_its_own_clock_already():
    """So that nothing changes for it, and once is enough."""
    recording = lasting("dead_time")
    own = on_own_clock(recording)
    assert (1.0, 1.0, recording.clock) == (own.interval_s, own.unit_s, own.clock)
    assert on_own_clock(own) is own


def test_converting_to_the_own_clock_and_back_changes_nothing():
    """Every time that a recording has goes along."""
    signal = Signal(np.arange(5.0), np.zeros(5, np.uint8), "V.OP", interval_s=0.05)
    recording = Recording(
        valve="V",
        signals={Role.OP: signal},
        interval_s=0.01,
        clock=ClockFacts(jitter_s=0.001, gaps=1, longest_gap_s=0.5),
    )
    own = on_own_clock(recording)
    close((own.interval_s, own.clock.jitter_s, own.clock.longest_gap_s), (1.0, 0.1, 50.0))
    close(own.op.interval_s, 5.0)
    assert repr(recording) == repr(own)
    back = off_own_clock(own)
    close((back.interval_s, back.clock.jitter_s), (0.01, 0.001))
    assert back.own_unit_s is None


def moved(samples, interval_s):
    """An OP that goes to and fro, and a stem that follows late."""
    op = 50.0 + 10.0 * np.sin(np.arange(samples) / 9.0)
    mv = np.concatenate((op[:2], op[:-2])) + 0.05 * np.cos(np.arange(samples) * 1.7)
    signals = {Role.OP: Signal.good(op, "V.OP"), Role.MV: Signal.good(mv, "V.ZT")}
    return Recording(valve="V", signals=signals, interval_s=interval_s)


@pytest.mark.parametrize("interval_s", [0.001, 0.01, 1.0, 60.0])
def test_how_long_a_recording_must_be_is_a_number_of_samples(interval_s):
    """300 of them, at any rate, where the plant does not say."""

    def slugs(samples, limits):
        obstacles = assess(on_own_clock(moved(samples, interval_s)), limits).obstacles
        return [item.slug for item in obstacles]

    assert ["too_short"] == slugs(290, Limits())
    assert [] == slugs(310, Limits())


@pytest.mark.parametrize(("interval_s", "short"), [(0.01, True), (1.0, True), (60.0, False)])
def test_seconds_that_a_plant_asked_for_stay_seconds(interval_s, short):
    """``min_duration_s`` means seconds of the plant."""
    recording = on_own_clock(moved(500, interval_s))
    obstacles = assess(recording, Limits(min_duration_s=600.0)).obstacles
    assert short is ("too_short" in [item.slug for item in obstacles])


@pytest.mark.parametrize(
    ("own", "unit_s", "answer"),
    [
        (12.0, 1.0, "12 s"),
        (7200.0, 1.0, "7200 s"),
        (4.0, 0.001, "4 ms"),
        (1500.0, 0.001, "1.5 s"),
        (4.0, 60.0, "4 min"),
        (1.0, 5.0, "5 s"),
        (300.0, 60.0, "5 h"),
        (5000.0, 60.0, "3.47 d"),
    ],
)
def test_a_time_is_said_in_the_unit_of_the_clock(own, unit_s, answer):
    """On a clock of seconds, times are in seconds."""
    assert answer == duration(own, unit_s)


def test_a_speed_is_said_by_the_second_the_minute_or_the_millisecond():
    """Whichever suits the clock."""
    assert ["0.5 %/s", "50 %/s", "5 %/ms", "0.5 %/min"] == [
        rate(0.5, 1.0),
        rate(0.5, 0.01),
        rate(5.0, 0.001),
        rate(0.5, 60.0),
    ]


def test_the_parts_of_a_record_are_named_by_their_time():
    """Minutes on a clock of seconds."""
    names = [parts_of_time(3600.0, unit_s, 2)[1] for unit_s in (1.0, 0.001, 60.0)]
    assert ["minute 30 to 60", "second 1.8 to 3.6", "hour 30 to 60"] == names


def test_a_unit_whose_power_of_time_is_not_known_is_an_error_that_says_where_it_belongs():
    """So that no number is left unconverted by oversight."""
    with pytest.raises(ValueError, match="POWER_OF_TIME"):
        seconds_of(1.0, "1/s2", 0.01)


def test_an_estimate_is_compared_in_own_units_and_said_in_true_ones():
    """What a term's sentence is given."""
    estimate = Estimate(value=3.6, low=3.2, high=4.0, unit="s")
    spoken = SpokenEstimate.of(estimate, 0.001)
    assert (3.6, "3.60 (3.20 to 4.00) ms") == (spoken.value, str(spoken))
    close(estimate_in_seconds(estimate, 0.001).high, 0.004)
    assert str(estimate) == str(SpokenEstimate.of(estimate, 1.0))
    wide = Estimate(value=9.9, low=8.3, high=11.4, unit="s")
    assert str(SpokenEstimate.of(wide, 0.1)) == "0.99 (0.83 to 1.14) s"
    assert str(SpokenEstimate.of(wide, 0.01)) == "99 (83 to 114) ms"
