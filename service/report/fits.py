"""How far each model's free run stays from MV on samples it was not fitted to, as bars."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stemwatch.models.screening_result import Residual
from stemwatch.service.report.words import finite

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
    """Standard deviation of MV where the first model is judged: what a constant would miss."""
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
