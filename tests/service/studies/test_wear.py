"""The study of wear forecasts: the alert comes before a worn stem sticks; a healthy valve has
none."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.service.studies.wear import LIMIT, WearKind, true_S, watch_valves


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
