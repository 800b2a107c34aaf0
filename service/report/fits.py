"""How far each model's free run stays from MV where it was not fitted, as bars to compare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from stemwatch.models.findings import Residual
from stemwatch.service.report.words import finite

MODEL_NAMES = {
    "stiction": "Stick-slip model",
    "narx": "NARX network",
    "baseline": "Baseline of the healthy valve",
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
    return [_bar(model, name, residuals.get(model)) for model, name in MODEL_NAMES.items()]


def spread_percent(residuals: Mapping[str, Residual | None]) -> float | None:
    """Standard deviation of MV on the held-out part: what a constant would miss it by."""
    for model in MODEL_NAMES:
        residual = residuals.get(model)
        if residual is None:
            continue
        rmse, normalised = finite(residual.rmse), finite(residual.normalised)
        if rmse is not None and normalised:
            return rmse / normalised
    return None


def _bar(model: str, name: str, residual: Residual | None) -> FitBar:
    normalised = None if residual is None else finite(residual.normalised)
    return FitBar(
        model=model,
        name=name,
        rmse=None if residual is None else finite(residual.rmse),
        fit_percent=None if residual is None else finite(residual.fit_percent),
        length=0.0 if normalised is None else round(100.0 * min(max(normalised, 0.0), 1.0), 1),
    )
