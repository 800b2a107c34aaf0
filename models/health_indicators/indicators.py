"""The health indicators of one screening: numbers to trend, each with unit and meaning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from stemwatch.models.closed_loop.what_if import Prediction
from stemwatch.models.estimate import Estimate
from stemwatch.models.health_indicators.indicator_meanings import MEANINGS
from stemwatch.models.preparation.own_clock import seconds_of
from stemwatch.models.recording import Recording
from stemwatch.models.screening_result import Indicator, Residual
from stemwatch.models.signals.excitation import reversals, swing, travel
from stemwatch.models.signals.oscillation import signal_oscillation
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.events import SlipEvents
from stemwatch.models.stickslip.fit import StickSlipFit
from stemwatch.models.stickslip.parameters import S_and_J
from stemwatch.models.stickslip.problem import FitProblem
from stemwatch.models.stickslip.speed_limits import shown_speed_limits
from stemwatch.models.without_position.suspicion import WithoutPosition


def _single_indicator(name: str, value: float | None, unit: str) -> list[Indicator]:
    """The indicator in a list; an empty list where the number is not known."""
    if value is None or not np.isfinite(value):
        return []
    meaning, worse = MEANINGS[name]
    return [Indicator(name=name, value=float(value), unit=unit, meaning=meaning, worse=worse)]


def in_seconds(indicators: Sequence[Indicator], recording: Recording) -> list[Indicator]:
    """Convert indicators from the recording's own clock to true units of time."""

    def true(indicator: Indicator) -> Indicator:
        numbers = (indicator.value, indicator.low, indicator.high)
        value, low, high = (
            None if number is None else seconds_of(number, indicator.unit, recording.unit_s)
            for number in numbers
        )
        assert value is not None
        return replace(indicator, value=value, low=low, high=high)

    return [true(indicator) for indicator in indicators]


def _estimated(name: str, estimate: Estimate) -> list[Indicator]:
    if estimate.value is None:
        return []
    meaning, worse = MEANINGS[name]
    return [
        Indicator(
            name=name,
            value=estimate.value,
            unit=estimate.unit,
            meaning=meaning,
            worse=worse,
            low=estimate.low,
            high=estimate.high,
        )
    ]


def of_repair(repaired: Prediction) -> list[Indicator]:
    """Predicted changes in the loop if its valve did not stick."""
    error = repaired.predicted["error_std"]
    return [
        *_single_indicator("control_error_std", repaired.recorded.error_std, error.unit),
        *_estimated("control_error_std_repaired", error),
        *_estimated("variance_from_sticking_percent", repaired.fall("error_std", squared=True)),
        *_estimated("control_error_from_sticking", repaired.saved("error_mean")),
        *_estimated("off_target_from_sticking_percent", repaired.saved("off_target")),
        *_estimated("travel_from_sticking_per_hour_percent", repaired.saved("travel_per_hour")),
    ]


def of_recording(recording: Recording) -> list[Indicator]:
    """Indicators that need no fit: movement of OP, oscillation, share of usable samples."""
    op = recording.op.values[np.isfinite(recording.op.values)]
    op_swing = swing(op)
    threshold = max(0.1 * op_swing, 0.2)
    usable = 100.0 * float(recording.usable.mean()) if len(recording) else 0.0
    indicators = [
        *_single_indicator("op_swing_percent", op_swing, "%"),
        *_single_indicator("op_reversals", float(reversals(op, threshold).size), ""),
        *_single_indicator("usable_percent", usable, "%"),
    ]
    cycle = signal_oscillation(recording.op, recording.interval_s)
    if cycle is not None and cycle.regular:
        indicators += _single_indicator("loop_period_s", cycle.period_s, "s")
        indicators += _single_indicator("loop_regularity", cycle.regularity, "")
    return indicators


def of_suspicion(suspicion: WithoutPosition) -> list[Indicator]:
    """The score of sticking from OP and PV alone, and the apparent S of a suspicion."""
    return [
        *_single_indicator("sticking_score", suspicion.score, ""),
        *_estimated("apparent_S_percent", suspicion.apparent_S),
    ]


def of_movement(problem: FitProblem, events: SlipEvents) -> list[Indicator]:
    """Indicators of the stem's movement: jumps, reversals, travel, and noise of the reading."""
    hours = problem.op.size * problem.interval_s / 3600.0
    threshold = max(5.0 * problem.sigma, 0.1)
    stem_travel = travel(problem.mv, threshold)
    count = float(events.count)
    turns = float(reversals(problem.mv, threshold).size)
    return [
        *_single_indicator("slip_count", count, ""),
        *_single_indicator("slips_per_hour", count / hours, "1/h"),
        *_single_indicator("jumped_percent", 100.0 * events.share, "%"),
        *_single_indicator("mv_reversals", turns, ""),
        *_single_indicator("travel_percent", stem_travel, "%"),
        *_single_indicator("travel_per_hour_percent", stem_travel / hours, "%/h"),
        *_single_indicator("position_noise_percent", problem.sigma, "%"),
    ]


def of_friction(
    fit: StickSlipFit, S: Estimate, J: Estimate, op_per_travel: float = 1.0
) -> list[Indicator]:
    """S, J, their size against the loop's movement, and the actuator; empty where S is not known.

    ``op_per_travel``: percent of OP for a percent of travel (``fit`` is in percent of travel).
    """
    if S.value is None:
        return []
    swing_of_op = fit.evaluator.problem.swing
    share = 100.0 * S.value / (op_per_travel * swing_of_op) if swing_of_op > 0 else None
    naive_S, naive_J = (op_per_travel * number for number in S_and_J(fit.naive))
    scatter = 100.0 * fit.breakaways.scatter if fit.breakaways else None
    zero = float(fit.candidate[coordinate.ZERO])
    left_behind = None if J.value is None else max(S.value - J.value, 0.0)
    indicators = [
        *_estimated("S_percent", S),
        *_estimated("J_percent", J),
        *_single_indicator("S_of_swing_percent", share, "%"),
        *_single_indicator("S_minus_J_percent", left_behind, "%"),
        *_single_indicator("dead_band_percent", left_behind, "%"),
        *_single_indicator("breakaway_scatter_percent", scatter, "%"),
        *_single_indicator("naive_S_percent", naive_S, "%"),
        *_single_indicator("naive_J_percent", naive_J, "%"),
        *_single_indicator("position_zero_percent", zero, "%"),
    ]
    if op_per_travel != 1.0:
        indicators += _single_indicator("S_of_travel_percent", S.value / op_per_travel, "%")
        indicators += _single_indicator(
            "J_of_travel_percent", (J.value or 0.0) / op_per_travel, "%"
        )
    return [*indicators, *(_of_actuator(fit) if fit.hypothesis == "both" else [])]


def _of_actuator(fit: StickSlipFit) -> list[Indicator]:
    """Dead time, lags and speed limits; only for a fit that needs more than friction."""
    c = fit.candidate
    indicators = [
        *_single_indicator("dead_time_s", float(c[coordinate.DEAD_TIME_S]), "s"),
        *_single_indicator("lag_rising_s", float(c[coordinate.LAG_UP_S]), "s"),
        *_single_indicator("lag_falling_s", float(c[coordinate.LAG_DOWN_S]), "s"),
    ]
    for name, speed in shown_speed_limits(fit).items():
        indicators += _single_indicator(f"speed_{name}_percent_per_s", speed, "%/s")
    return indicators


def of_residuals(residuals: Mapping[str, Residual | None], ratio: float | None) -> list[Indicator]:
    """Residual and fit of each model on held-out data, and the baseline ratio."""
    indicators: list[Indicator] = []
    for name, residual in residuals.items():
        if residual is None:
            continue
        indicators += _single_indicator(f"{name}_rmse_percent", residual.rmse, "%")
        indicators += _single_indicator(f"{name}_fit_percent", residual.fit_percent, "%")
        indicators += _single_indicator(f"{name}_one_step_rmse_percent", residual.one_step, "%")
    return [*indicators, *_single_indicator("baseline_ratio", ratio, "")]
