"""When S will reach a limit, and when no forecast is given."""

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.wear_forecast import FEWEST_DAYS, WearForecast, forecast_wear

DAYS = np.arange(0, 84, 2.0)


def with_error(S, seed=1, size=0.05):
    """S as it is estimated."""
    return S + size * np.random.default_rng(seed).standard_normal(S.size)


@pytest.mark.parametrize("per_week", [0.08, 0.1])
def test_steady_wear_is_foreseen_within_its_interval(per_week):
    """From 0.1 %, towards 1.5 %."""
    S = 0.1 + per_week / 7.0 * DAYS
    until = forecast_wear(DAYS, with_error(S), 1.5).until
    truth = (1.5 - S[-1]) / per_week
    assert until.low < truth
    assert until.high is None or until.high > truth
    assert until.value == pytest.approx(truth, rel=0.5)


def test_the_same_values_give_the_same_forecast():
    """It is seeded."""
    S = with_error(0.1 + 0.015 * DAYS)
    assert forecast_wear(DAYS, S, 1.5) == forecast_wear(DAYS, S, 1.5)


def test_no_trend_is_claimed_where_there_is_none():
    """Thirty steady valves, at several levels."""
    claimed = [
        forecast_wear(DAYS, with_error(np.full(DAYS.size, 0.1 + 0.04 * seed), seed), 1.5)
        for seed in range(30)
    ]
    assert [item.until.value for item in claimed] == [None] * 30


def test_a_valve_beyond_the_limit_and_one_that_never_reaches_it_say_so():
    """A reason in place of a number."""
    beyond = forecast_wear(DAYS, with_error(1.0 + 0.02 * DAYS), 1.5)
    assert beyond.until.reason == "S is at 1.5 % already"
    far = forecast_wear(DAYS, with_error(0.1 + 0.006 * DAYS), 15.0)
    assert "within a year" in far.until.reason
    assert far.words == ""


def test_few_days_give_no_forecast():
    """Fewer than eight, or eight within a week."""
    few = forecast_wear(DAYS[: FEWEST_DAYS - 1], DAYS[: FEWEST_DAYS - 1] * 0.1, 1.5)
    assert "is needed" in few.until.reason
    close = forecast_wear(np.arange(9.0), np.arange(9.0) * 0.1, 1.5)
    assert "is needed" in close.until.reason


def test_weeks_without_a_screening_are_bridged():
    """Three weeks are missing; the interval still holds what comes."""
    S = 0.1 + 0.014 * DAYS
    there = (DAYS < 30) | (DAYS > 51)
    until = forecast_wear(DAYS[there], with_error(S)[there], 1.5).until
    truth = (1.5 - S[-1]) / 0.014 / 7.0
    assert until.low < truth
    assert until.high is None or until.high > truth


def test_the_words_name_limit_and_weeks():
    """For a ranking."""
    words = forecast_wear(DAYS, with_error(0.1 + 0.014 * DAYS), 1.5).words
    assert words.startswith("reaches 1.5 % in ")
    assert "weeks" in words
    next_week = Estimate(value=1.1, low=0.9, high=1.2, unit="weeks")
    assert WearForecast(limit=1.5, until=next_week).words == "reaches 1.5 % in about 1 week"
