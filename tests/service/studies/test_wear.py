"""The study of foresight: the alert comes before a worn stem sticks; one that is well has none."""

from __future__ import annotations

from stemwatch.service.studies.wear import WearKind, watch_valves


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
