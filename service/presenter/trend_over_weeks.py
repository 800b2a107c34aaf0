"""How S changes over weeks: its rate per month with an interval, which one run cannot show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from stemwatch.models.wear_forecast import WearForecast, forecast_wear

WEEKS = 12  # that are looked back
DAYS_A_MONTH = 365.25 / 12.0
FEWEST_DAYS = 4  # with a screening that knows S
SHORTEST_DAYS = 7.0  # from the first to the last of them
LIKELY_RISING = 0.9  # probability from which a rise that is not claimed is not denied either
SMALLEST_PERCENT = 0.2  # over the time that was seen; less than a plant's data can show


@dataclass(frozen=True, kw_only=True)
class TrendOverWeeks:
    """The rate of S in percent of OP span a month, with its 95 % interval, over ``days``."""

    per_month: float
    low: float
    high: float
    days: float
    forecast: WearForecast | None = None

    @property
    def is_change(self) -> bool:
        """Whether the interval leaves no rate of 0, and what came together could be seen at all."""
        total_change = abs(self.per_month) * self.days / DAYS_A_MONTH
        return not self.low <= 0.0 <= self.high and total_change >= SMALLEST_PERCENT

    def foresees_within(self, weeks: float) -> bool | None:
        """Whether S more likely than not reaches the limit within ``weeks``; ``None`` where that is
        not plain: within twice as many, or S rises and nobody can say when it is there."""
        if self.forecast is None:
            return False
        until = self.forecast.until.value
        if until is None:
            return None if self.forecast.probability_rises >= LIKELY_RISING else False
        return until <= weeks or (None if until <= 2.0 * weeks else False)

    @property
    def words(self) -> str:
        """The rate for a reader."""
        text = f"S {self.per_month:+.2f} % a month ({self.low:+.2f} to {self.high:+.2f})"
        text = text.replace("-", "\N{MINUS SIGN}")
        foreseen = "" if self.forecast is None else self.forecast.words
        return f"{text}, {foreseen}" if foreseen and self.is_change else text


def trend_over_weeks(
    days: Sequence[float], S: Sequence[float], limit: float | None = None
) -> TrendOverWeeks | None:
    """The slope of ``S`` (n,), a day's mean each, over ``days`` (n,), by least squares with
    Student's t for n - 2 degrees of freedom; ``None`` where so few days tell nothing. Where S rises
    towards ``limit``, percent, when it will reach it."""
    t, y = np.asarray(days, dtype=np.float64), np.asarray(S, dtype=np.float64)
    if t.size < FEWEST_DAYS or np.ptp(t) < SHORTEST_DAYS:
        return None
    centred = t - t.mean()
    spread = float(centred @ centred)
    slope = float(centred @ y) / spread
    residual = y - y.mean() - slope * centred
    freedom = t.size - 2
    error = float(np.sqrt(residual @ residual / freedom / spread))
    reach = float(stdtrit(freedom, 0.975)) * error
    trend = TrendOverWeeks(
        per_month=DAYS_A_MONTH * slope,
        low=DAYS_A_MONTH * (slope - reach),
        high=DAYS_A_MONTH * (slope + reach),
        days=float(np.ptp(t)),
    )
    if limit is None or not trend.is_change or slope <= 0.0:
        return trend
    return replace(trend, forecast=forecast_wear(days, S, limit))
