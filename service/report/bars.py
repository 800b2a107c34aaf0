"""Bars of the page: how far each model stays from MV, and where S and J stand.

A model's bar is the residual of its free run on samples it was not fitted to; S and J are drawn on
one scale for all valves, so that they can be compared by eye.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from stemwatch.models.estimate import Estimate
from stemwatch.models.screening_result import Residual, Screening
from stemwatch.service.presenter.wording import finite
from stemwatch.service.report.charts.axes import next_round_number

MODEL_NAMES = {
    "stiction": "Stick-slip model",
    "narx": "NARX network",
    "baseline": "Baseline, whole window",
}


@dataclass(frozen=True, kw_only=True)
class FitBar:
    """``rmse`` in percent of span; ``length`` of the bar in percent, 100 for MV's own spread."""

    model: str
    name: str
    rmse: float | None
    fit_percent: float | None
    length: float


def fit_bars(residuals: Mapping[str, Residual | None]) -> list[FitBar]:
    """One bar per model in the order of ``MODEL_NAMES``; empty where no model has a residual."""
    if not any(residuals.get(model) for model in MODEL_NAMES):
        return []
    spread = spread_percent(residuals)
    return [_bar(model, name, residuals.get(model), spread) for model, name in MODEL_NAMES.items()]


def spread_percent(residuals: Mapping[str, Residual | None]) -> float | None:
    """Standard deviation of MV where the first model is judged: the error of a constant."""
    for model in MODEL_NAMES:
        residual = residuals.get(model)
        if residual is None:
            continue
        rmse, normalised = finite(residual.rmse), finite(residual.normalised)
        if rmse is not None and normalised:
            return rmse / normalised
    return None


def _bar(model: str, name: str, residual: Residual | None, spread: float | None) -> FitBar:
    rmse = None if residual is None else finite(residual.rmse)
    share = 0.0 if rmse is None or not spread else rmse / spread
    return FitBar(
        model=model,
        name=name,
        rmse=rmse,
        fit_percent=None if residual is None else finite(residual.fit_percent),
        length=round(100.0 * min(max(share, 0.0), 1.0), 1),
    )


SMALLEST_TOP_PERCENT = 2.0


@dataclass(frozen=True, kw_only=True)
class Gauge:
    """Positions on the bar in percent of its length; ``beyond`` where the value is off it."""

    at: float
    low: float
    high: float
    beyond: bool


def gauge_top(screenings: Iterable[Screening]) -> float:
    """``bar_top`` of all S and J of ``screenings``."""
    values = [
        finite(estimate.value) or 0.0
        for screening in screenings
        for estimate in (screening.S, screening.J)
    ]
    return bar_top(max(values, default=0.0))


def bar_top(largest_percent: float) -> float:
    """The round number at the right end of all bars of S and J, percent of OP span: it holds the
    largest value."""
    return next_round_number(max(SMALLEST_TOP_PERCENT, largest_percent))


def gauge(estimate: Estimate, top: float) -> Gauge | None:
    """``estimate`` on a bar from 0 to ``top``; ``None`` where there is no value."""
    value = finite(estimate.value)
    if value is None:
        return None
    low, high = finite(estimate.low), finite(estimate.high)
    return Gauge(
        at=_position_percent(value, top),
        low=_position_percent(value if low is None else low, top),
        high=_position_percent(value if high is None else high, top),
        beyond=high is not None and high > top,
    )


def _position_percent(value: float, top: float) -> float:
    return round(100.0 * min(max(value / top, 0.0), 1.0), 1)
