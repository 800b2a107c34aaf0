"""The force balance finds a drive's own numbers, and none in a valve that slips between samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import savgol_filter

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Stiction
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import problem_of
from stemwatch.models.mismatch.stiction import of_balance
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import Role
from stemwatch.models.stickslip.force_balance import AT_LIMIT, force_balance, parabolas
from stemwatch.models.studies.simulator.hidden import draw_effect, draw_nulls
from tests.benchmarks.bench_other_motors import draw
from tests.models.mismatch.simulated_drive import drive


def balanced(recording):
    """The balance of a recording as ``explain`` takes it, and seconds in the unit of its times."""
    own = on_own_clock(recording)
    return force_balance(problem_of(own, measured_record(own))), own.unit_s


@pytest.mark.parametrize("window", [7, 15, 45, 241])
def test_the_low_pass_is_that_of_savitzky_and_golay(window):
    """To the bit, ends included: value, slope and curvature as scipy gives them."""
    rng = np.random.default_rng(4)
    for values in (
        50.0 + np.cumsum(rng.normal(0.0, 0.3, 1000)),
        np.round(50.0 + np.cumsum(rng.normal(0.0, 0.3, 2 * window)), 1),
    ):
        expected = [savgol_filter(values, window, 2, deriv=order) for order in range(3)]
        np.testing.assert_array_equal(parabolas(values, window), expected)


@pytest.mark.parametrize(
    ("S", "lag_s", "run_up_s", "load"),
    [(1.2, 0.3, 0.06, 2.0), (1.0, 0.3, 0.06, 4.0), (0.6, 0.12, 0.05, 1.0), (0.1, 0.06, 0.03, 0.3)],
)
def test_friction_lag_and_load_are_those_of_the_drive(S, lag_s, run_up_s, load):
    """Within a tenth, from an encoder of 4096 counts."""
    result, unit_s = balanced(drive(S, lag_s=lag_s, run_up_s=run_up_s, load=load))
    assert result.S == pytest.approx(S, rel=0.12, abs=0.03)
    assert result.lag_s * unit_s == pytest.approx(lag_s, rel=0.2)
    assert 0.5 * run_up_s < result.run_up_s * unit_s < 2.0 * run_up_s
    low, high = np.percentile(result.S_replicates, (2.5, 97.5))
    assert low < 1.1 * S + 0.03
    assert high > 0.9 * S - 0.03
    z = 0.4  # 70 to 30 % of a turn
    pull = float(result.load @ np.array([2.0 * z, 0.0, 2.0 * z**3]))
    assert pull == pytest.approx(2.0 * load * np.sin(np.pi * z), rel=0.12)


@pytest.mark.parametrize(
    ("S", "run_up_s"), [(0.6, 0.016), (0.2, 0.012), (0.6, 0.002), (1.5, 0.003)]
)
def test_a_motor_with_little_inertia_is_a_drive(S, run_up_s):
    """A run-up of a sample shows in fast motion; one below a third of a sample cannot be seen, but
    next to nothing is left then. Friction is read off no worse."""
    result, unit_s = balanced(drive(S, lag_s=0.2, run_up_s=run_up_s))
    assert result.S == pytest.approx(S, rel=0.12, abs=0.03)
    assert result.lag_s * unit_s == pytest.approx(0.2, rel=0.2)


@pytest.mark.parametrize("factor", [0.001, 60.0])
def test_the_time_unit_does_not_matter(factor):
    """The same samples further apart: the same percent, and times that are as much longer."""
    plain, unit_s = balanced(drive())
    other = replace(drive(), interval_s=0.01 * factor)
    scaled, other_unit_s = balanced(other)
    assert scaled.S == pytest.approx(plain.S)
    assert scaled.lag_s * other_unit_s == pytest.approx(factor * plain.lag_s * unit_s)


def test_single_wrong_readings_do_no_harm():
    """An encoder that reads 0 now and then."""
    recording = drive()
    mv = recording.mv.values.copy()
    mv[::97] = 0.0
    signals = {**recording.signals, Role.MV: replace(recording.mv, values=mv)}
    result, _ = balanced(replace(recording, signals=signals))
    assert result.S == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize(
    "slug",
    [
        "null",
        pytest.param("actuator_lag", marks=pytest.mark.long),
        pytest.param("viscous_drag", marks=pytest.mark.long),
        "underdamped_positioner",
    ],
)
def test_a_process_valve_shows_none(slug):
    """Its stem slips between two samples, or is slow without any inertia that shows."""
    cases = draw_nulls(1, 6161) if slug == "null" else draw_effect(slug, 1, 6161)
    for case in cases:
        run = case.simulated()
        result, _ = balanced(run.recording)
        assert result is None


@pytest.mark.parametrize(
    "slug",
    [
        "actuator_lag",
        "viscous_drag",
        pytest.param("dead_time", marks=pytest.mark.long),
        pytest.param("underdamped_positioner", marks=pytest.mark.long),
    ],
)
def test_a_process_valve_that_is_as_quick_as_a_motor_shows_none(slug):
    """Its time taken for a twentieth: what tells a drive is not that it is quick."""
    for case in draw_effect(slug, 2, 6161):
        recording = case.simulated().recording
        quick = replace(recording, interval_s=recording.interval_s / 20.0)
        assert balanced(quick)[0] is None


@pytest.mark.parametrize(("S", "top_speed"), [(0.6, 25.0), (1.0, 30.0)])
def test_a_voltage_that_meets_its_limit_does_not_widen_S(S, top_speed):
    """The error at which it does is found with it, and S is that of the friction."""
    result, _ = balanced(drive(S, lag_s=0.2, top_speed=top_speed))
    assert result.most_error == pytest.approx(0.2 * top_speed, rel=0.1)
    assert result.S == pytest.approx(S, rel=0.12, abs=0.05)


def test_a_motor_that_gives_way_to_its_load_has_a_wide_S():
    """It falls and swings where the weight pulls more than it can hold."""
    result, _ = balanced(drive(1.0, lag_s=0.2, load=6.0, top_speed=18.0))
    S = of_balance(result, Stiction(S=Estimate(value=9.0), J=Estimate(value=0.0))).S
    assert S.low <= 1.0 <= S.high
    held, _ = balanced(drive(1.0, lag_s=0.2, load=2.0, top_speed=30.0))
    narrow = of_balance(held, Stiction(S=Estimate(value=9.0), J=Estimate(value=0.0))).S
    assert S.high - S.low > 1.5 * (narrow.high - narrow.low)


@pytest.mark.parametrize("number", [6, 51])
def test_a_motor_whose_load_cannot_be_told_has_no_S_but_a_reason(number):
    """Its pull and its limit are about the same, and the balance finds a load without end."""
    _, recording = draw(1, number)
    assert balanced(recording)[0] == AT_LIMIT
    if number == 6:  # which a curve from OP to stroke would explain, with friction in one place
        assert explain(recording).restated.S.reason == AT_LIMIT


def test_a_drive_at_rest_shows_none():
    """There is no motion to take speeds from."""
    recording = drive()
    still = {
        role: replace(signal, values=np.full(len(recording), 50.0))
        for role, signal in recording.signals.items()
    }
    assert balanced(replace(recording, signals=still))[0] is None
