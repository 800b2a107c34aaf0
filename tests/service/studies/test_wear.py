"""The study of wear forecasts: the alert comes before a worn stem sticks; a healthy valve has
none."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.wear_forecast import WearForecast
from stemwatch.service.studies.wear import (
    LIMIT,
    AlertedValve,
    ForecastCase,
    WearKind,
    alert_rows,
    forecast_rows,
    true_S,
    watch_valves,
)


def test_a_valve_that_wears_is_foreseen_and_one_that_does_not_is_left_alone() -> None:
    """By the alert's own rule, looked at every week; a development seed."""
    kinds = (WearKind.NONE, WearKind.STEADY)
    watched = list(watch_valves(4, 5151, 8.0, kinds))
    steady = [valve for valve in watched if valve.wear is WearKind.STEADY]
    assert [valve.alerted for valve in watched if valve.wear is WearKind.NONE] == [None] * 4
    assert all(valve.crosses is not None for valve in steady)
    ahead = [valve.weeks_ahead for valve in steady if valve.weeks_ahead is not None]
    assert len(ahead) >= 3
    assert all(weeks > 0.0 for weeks in ahead)


def test_a_repair_that_nobody_recorded_puts_off_the_limit() -> None:
    """S falls back once, before it reaches the limit, and rises as it did."""
    for seed in range(20):
        S = true_S(WearKind.REPAIRED, np.random.default_rng(seed))
        (mended,) = np.flatnonzero(np.diff(S) < 0.0)
        assert S[mended] < LIMIT
        assert S[mended + 1] == pytest.approx(S[0])


def test_forecasts_are_counted_by_wear_and_all_that_wear_together() -> None:
    """A case without weeks counts among the valves alone; one that never reaches has no error."""
    until = Estimate(value=4.0, low=3.0, high=None)
    none = WearForecast(limit=LIMIT, until=Estimate.unknown("no trend"))
    seen = WearForecast(limit=LIMIT, until=until)
    cases = [
        ForecastCase(wear=WearKind.NONE, forecast=none, weeks=np.inf),
        ForecastCase(wear=WearKind.STEADY, forecast=seen, weeks=5.0),
        ForecastCase(wear=WearKind.STEADY, forecast=seen, weeks=2.0),
    ]
    rows = {row.wear: row for row in forecast_rows(cases)}
    assert (rows["none"].valves, rows["none"].foreseen, rows["none"].error_weeks) == (1, 0, None)
    both = rows["all that wear"]
    assert (both.valves, both.claimed, both.foreseen, both.holds, both.half_open) == (2, 2, 2, 1, 2)
    assert both.error_weeks == pytest.approx(1.5)


def test_alerts_are_counted_by_wear() -> None:
    """Weeks ahead are of those that reach the limit after an alert."""
    watched = [
        AlertedValve(wear=WearKind.STEADY, alerted=70, crosses=84),
        AlertedValve(wear=WearKind.STEADY, alerted=None, crosses=90),
        AlertedValve(wear=WearKind.REPAIRED, alerted=30, crosses=None),
    ]
    rows = {row.wear: row for row in alert_rows(watched)}
    steady = rows[WearKind.STEADY.value]
    assert (steady.valves, steady.crosses, steady.alerted, steady.weeks_ahead) == (2, 2, 1, 2.0)
    assert rows[WearKind.REPAIRED.value].weeks_ahead is None
