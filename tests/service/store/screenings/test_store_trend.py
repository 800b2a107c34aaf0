"""S and J over weeks: a rise that no single run shows is said, with its rate and interval."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.trend_over_weeks import trend_over_weeks
from stemwatch.models.limits import Limits
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.report.change_since_last_run import change_since_last_run
from stemwatch.service.store.store import Store, open_store
from tests.service.report.conftest import screening

BEGAN = datetime(2026, 1, 5, 6, 0, tzinfo=UTC)
RISING = (0.46, 1.27, 2.60, 2.94)


def of_week(week: int, S: float) -> Screening:
    """An hour of a valve, with an interval far wider than a week's step."""
    result = screening("FIC-1", Verdict.STICKY, samples=60)
    assert result.recording is not None
    recording = replace(result.recording, start=BEGAN + timedelta(weeks=week))
    estimate = Estimate(value=S, low=S - 2.0, high=S + 2.0, unit="%")
    return replace(result, S=estimate, recording=recording)


def saved(store: Store, sizes: tuple[float, ...]) -> Screening:
    """A run a week; the last one."""
    for week, S in enumerate(sizes):
        store.save(last := of_week(week, S), store.begin_run(software_version="1"))
    return last


def test_a_rise_over_weeks_is_worse_although_no_run_shows_it(store: Store) -> None:
    """The interval of each run holds the S before it; the slope over weeks does not hold 0."""
    last = saved(store, RISING)
    before = store.previous_finding(last)
    assert change_since_last_run(last, last.verdict, before).words == "no change"
    trend = store.trends(["FIC-1"], Limits())["FIC-1"]
    assert trend.low > 0.0
    per_week = np.polyfit(range(4), RISING, 1)[0]
    assert trend.per_month == pytest.approx(per_week / 7.0 * 365.25 / 12.0)
    change = change_since_last_run(last, last.verdict, before, trend)
    assert change.direction == "worse"
    assert f"S +{trend.per_month:.2f} % a month" in change.words


def test_j_has_a_trend_of_its_own(store: Store) -> None:
    """J falls while S rises; a day without a J is none of its days."""
    for week, J in enumerate((2.0, 1.6, None, 1.1, 0.8, 0.4)):
        unknown = Estimate.unknown("no slip was seen", "%")
        estimate = unknown if J is None else Estimate(value=J, unit="%")
        result = replace(of_week(week, 2.0 + 0.3 * week), J=estimate)
        store.save(result, store.begin_run(software_version="1"))
    of_J = store.trends(["FIC-1"], Limits())["FIC-1"].J
    assert of_J is not None
    assert of_J.is_change
    per_week = np.polyfit([0, 1, 3, 4, 5], [2.0, 1.6, 1.1, 0.8, 0.4], 1)[0]
    assert of_J.per_month == pytest.approx(per_week / 7.0 * 365.25 / 12.0)
    assert of_J.words.startswith(f"J −{-of_J.per_month:.2f} % a month (−")


def test_a_day_is_one_of_utc_whatever_the_clock_of_the_database(
    store: Store, store_url: str
) -> None:
    """The evening in Europe is the next day in Tokyo."""
    means = []
    for week, S in enumerate(RISING):
        for hours, more in ((0, 0.0), (14, 0.4)):
            result = of_week(week, S + more)
            assert result.recording is not None
            start = result.recording.start + timedelta(hours=hours)
            moved = replace(result, recording=replace(result.recording, start=start))
            store.save(moved, store.begin_run(software_version="1"))
        means.append(S + 0.2)
    is_sqlite = store_url.startswith("sqlite")
    in_tokyo = store_url if is_sqlite else f"{store_url}&options=-c%20TimeZone%3DAsia/Tokyo"
    with open_store(in_tokyo) as elsewhere:
        trend = elsewhere.trends(["FIC-1"], Limits())["FIC-1"]
    per_week = np.polyfit(range(4), means, 1)[0]
    assert trend.per_month == pytest.approx(per_week / 7.0 * 365.25 / 12.0)


def test_work_begins_a_new_trend(store: Store) -> None:
    """What was before the work says nothing of the valve after it."""
    saved(store, RISING)
    store.record_maintenance("FIC-1", BEGAN + timedelta(weeks=2), "packing renewed", "")
    assert store.trends(["FIC-1"], Limits()) == {}


def test_many_runs_a_day_are_one_point(store: Store) -> None:
    """An hourly plant has no trend after a day."""
    for hour in range(6):
        result = of_week(0, 1.0 + hour)
        assert result.recording is not None
        changed = replace(result.recording, start=BEGAN + timedelta(hours=hour))
        store.save(replace(result, recording=changed), store.begin_run(software_version="1"))
    assert store.trends(["FIC-1", "FIC-2"], Limits()) == {}


def test_noise_alone_is_no_change() -> None:
    """S to and fro, and a slope too small for a plant's data."""
    days = list(range(0, 56, 7))
    to_and_fro = trend_over_weeks(days, [1.0, 1.4, 0.9, 1.2, 1.3, 0.8, 1.1, 1.2])
    assert to_and_fro is not None
    assert not to_and_fro.is_change
    tiny = trend_over_weeks(days, [1.0 + 0.001 * day for day in days])
    assert tiny is not None
    assert not tiny.is_change


def test_a_valve_that_wears_says_when_it_will_be_sticky(store: Store) -> None:
    """S rises by 0.1 % a week from 0.2 %: 1.5 % is some weeks off, and the words say so."""
    last = saved(store, tuple(0.2 + 0.1 * week for week in range(10)))
    trend = store.trends(["FIC-1"], Limits())["FIC-1"]
    assert trend.forecast is not None
    until = trend.forecast.until
    assert until.low is not None
    assert until.low <= 4.0 <= (until.high or 99.0)
    before = store.previous_finding(last)
    change = change_since_last_run(last, last.verdict, before, trend)
    assert "reaches 1.5 % in" in change.words
    strict = store.trends(["FIC-1"], Limits(watch_S_percent=0.3, sticky_S_percent=0.5))["FIC-1"]
    assert strict.forecast is not None
    assert strict.forecast.until.reason == "S is at 0.5 % already"


def test_a_valve_that_heals_foresees_nothing(store: Store) -> None:
    """S that falls reaches no limit."""
    saved(store, tuple(1.2 - 0.1 * week for week in range(10)))
    assert store.trends(["FIC-1"], Limits())["FIC-1"].forecast is None
