"""Reports by exception come late, which looks like a lag: what a lag or a drag then takes from S is
not known to be none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import pytest

from stemwatch.models.recording import Role
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.studies.simulator import PlantLoop, draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.historian import exception_report
from stemwatch.models.verdict import Verdict

DEVIATION = 1.0  # percent
Draw = Callable[[int, int], list[PlantLoop]]


@cache
def behind_reports(number: int, draw: Draw = draw_sticky) -> tuple[float, Screening]:
    """The S of a valve, percent, and its screening from reports of 1 % of span."""
    loop = draw(number + 1, 8181)[number]
    recording = simulate_loop(loop, 8181 + number).recording
    signals = dict(recording.signals)
    for role in (Role.OP, Role.MV):
        values = exception_report(signals[role].values, DEVIATION)
        signals[role] = replace(signals[role], values=values)
    (one,) = screen([Case(recording=replace(recording, signals=signals))], Options(narx=False))
    return loop.valve.S, one


def test_a_sticking_valve_behind_reports_is_not_healthy_because_a_lag_fits():
    """Of an S of 2.5 % a fit with a lag leaves none; that of friction alone is within the
    interval."""
    _, one = behind_reports(7)
    assert one.verdict is not Verdict.HEALTHY
    assert one.S.high is not None
    assert one.S.high >= one.S.value + DEVIATION


@pytest.mark.parametrize("number", [0, 8])
def test_the_interval_holds_s_where_a_lag_was_named(number):
    """It is as wide as the reports leave it, and as far as friction alone would reach."""
    S, one = behind_reports(number)
    assert one.mismatch is not None
    assert one.mismatch.effects
    assert one.S.low <= S <= one.S.high


def test_reports_count_where_a_lag_was_fitted_beside_friction():
    """A healthy valve: of the S of friction alone the fit with a lag leaves less than half."""
    _, one = behind_reports(8, draw_healthy)
    assert one.S.high is not None
    assert one.S.high >= one.S.value + 0.9 * DEVIATION
    assert any("stored reports by exception" in said for said in one.provenance.decisions)


@pytest.mark.parametrize("number", [4, 7])
def test_no_slow_actuator_is_named_in_the_place_of_friction_behind_reports(number):
    """A drag or lag of healthy valves that has the S of friction alone may be the reports' own."""
    _, one = behind_reports(number, draw_healthy)
    assert one.mismatch is not None
    assert not one.mismatch.effects
    assert "come late" in one.mismatch.sentence
