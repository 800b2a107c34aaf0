"""Numbers a planner can trend."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.health_indicators import indicators
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening_result import Indicator, Residual
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.studies.simulator import Actuator, PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.loop import Load, LoadKind


@cache
def simulated(lag_s=0.1, dead_time_s=0.0, S=5.0, J=4.0):
    return simulate_loop(
        PlantLoop(
            valve=SimulatedValve(
                S=S, J=J, actuator=Actuator(air_lag_s=lag_s, dead_time_s=dead_time_s)
            ),
            setpoints=((10.0, 51.3), (400.0, 55.0), (800.0, 47.0), (1200.0, 52.0)),
            loads=(Load(kind=LoadKind.COLOURED, size=1.0, time_s=20.0),),
            duration_s=1800.0,
        ),
        2,
    )


def all_of(fit, S, J):
    return [
        *indicators.of_movement(fit.evaluator.problem, fit.events),
        *indicators.of_friction(fit, S, J),
    ]


@cache
def of_fit(*valve) -> dict[str, Indicator]:
    fit = fit_stickslip(simulated(*valve).recording)
    S, J = (Estimate(value=v, low=0.9 * v, high=1.1 * v, unit="%") for v in (fit.S, fit.J))
    return {item.name: item for item in all_of(fit, S, J)}


def named(result) -> dict[str, float]:
    return {item.name: item.value for item in result}


def test_every_indicator_says_what_it_is():
    """Each has a snake-case name, a finite value, a meaning, and a direction that is worse."""
    matching = [*indicators.of_recording(simulated().recording), *of_fit(2.0, 1.0).values()]
    names = [item.name for item in matching]
    assert len(names) == len(set(names))
    for item in matching:
        assert item.name.replace("_", "").isalnum()
        assert np.isfinite(item.value)
        assert item.meaning
        assert item.worse in ("up", "down", "none")


def test_movement_of_a_recording():
    """Swing, reversals and usable share are those of the signal."""
    t = np.arange(1000.0)
    op = 50.0 + 5.0 * np.sin(2 * np.pi * t / 100.0)
    mv = np.where(t < 100, np.nan, op)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "MV")}
    selection = named(
        indicators.of_recording(Recording(valve="V", signals=signals, interval_s=1.0))
    )
    assert abs(selection["op_swing_percent"] - 10.0) < 0.1
    assert 20.0 == selection["op_reversals"]
    assert 90.0 == selection["usable_percent"]
    assert abs(selection["loop_period_s"] - 100.0) < 2.0


@pytest.mark.parametrize("op", [[], [50.0], [np.nan] * 100])
def test_next_to_nothing(op):
    """No sample, one sample or no number at all give finite indicators."""
    signals = {Role.OP: Signal.good(np.array(op, dtype=float), "OP")}
    selection = named(
        indicators.of_recording(Recording(valve="V", signals=signals, interval_s=1.0))
    )
    assert 0.0 == selection["op_swing_percent"]
    assert np.isfinite(list(selection.values())).all()


def test_S_and_J_carry_their_intervals():
    """S and J are indicators with the interval of their estimates."""
    S = of_fit()["S_percent"]
    assert abs(S.value - 5.0) < 0.5
    assert (0.9 * S.value, 1.1 * S.value) == (S.low, S.high)
    assert abs(of_fit()["J_percent"].value - 4.0) < 0.5


def test_dead_band_and_wear():
    """S - J is an indicator; slips and travel per hour are those of half an hour, doubled."""
    results = {name: item.value for name, item in of_fit().items()}
    assert abs(results["dead_band_percent"] - (results["S_percent"] - results["J_percent"])) < 1e-9
    assert abs(results["slips_per_hour"] - 2.0 * results["slip_count"]) < 1e-6
    assert abs(results["travel_per_hour_percent"] - 2.0 * results["travel_percent"]) < 1e-6


def test_S_and_J_are_the_only_ones_of_a_valve():
    """S - J and S in percent of the swing are of the S and J that the pages show."""
    fit = fit_stickslip(simulated().recording)
    S, J = Estimate(value=3.0, unit="%"), Estimate(value=1.0, unit="%")
    results = {item.name: item.value for item in indicators.of_friction(fit, S, J)}
    assert results["S_minus_J_percent"] == results["dead_band_percent"] == 2.0
    assert results["S_of_swing_percent"] == pytest.approx(300.0 / fit.evaluator.problem.swing)
    unknown = Estimate.unknown("too few slips", unit="%")
    assert "S_minus_J_percent" not in {
        item.name for item in indicators.of_friction(fit, S, unknown)
    }


def test_slips_of_a_sticking_stem():
    """The slips that are counted are those of the simulated stem, within a tenth."""
    jumps = np.abs(np.diff(simulated().stem)) > 2.0
    true = np.sum(jumps[1:] & ~jumps[:-1])
    assert abs(of_fit()["slip_count"].value - true) <= 0.1 * true


def test_actuator_only_where_it_is_asked_for():
    """Lags and dead time are indicators of a slow actuator, and of no quick one."""
    assert "lag_rising_s" not in of_fit()
    slow = of_fit(2.0, 1.0, 0.3, 0.0)
    total = slow["dead_time_s"].value + 0.5 * (
        slow["lag_rising_s"].value + slow["lag_falling_s"].value
    )
    assert abs(total - 3.0) < 0.7


def test_residuals():
    """Each residual that is there becomes rmse, fit and, for a network, one-step error."""
    residuals = {
        "stiction": Residual(rmse=0.5, normalised=0.2),
        "narx": Residual(rmse=0.3, normalised=0.1, one_step=0.05),
        "baseline": None,
    }
    selection = named(indicators.of_residuals(residuals, 1.4))
    assert 0.5 == selection["stiction_rmse_percent"]
    assert 80.0 == selection["stiction_fit_percent"]
    assert "stiction_one_step_rmse_percent" not in selection
    assert 0.05 == selection["narx_one_step_rmse_percent"]
    assert "baseline_rmse_percent" not in selection
    assert 1.4 == selection["baseline_ratio"]


def test_infinite_numbers_give_no_indicator():
    """An infinite rmse is no indicator."""
    residuals = {"narx": Residual(rmse=np.inf, normalised=0.1)}
    assert "narx_rmse_percent" not in named(indicators.of_residuals(residuals, None))
