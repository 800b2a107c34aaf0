"""How S, J or the size of an effect changes over weeks: its rate per month with an interval, which
one run cannot show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date

import numpy as np
from scipy.special import stdtrit

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.fall_of_stiction import history_since_fall
from stemwatch.models.history.wear_forecast import WearForecast, forecast_wear
from stemwatch.models.recording import PERCENT

WEEKS = 12  # of history that enter the trend
DAYS_A_MONTH = 365.25 / 12.0
FEWEST_DAYS = 4  # with a screening that knows S
SHORTEST_DAYS = 7.0  # from the first to the last of them
LIKELY_RISING = 0.9  # probability from which a rise, though not significant, is not excluded either
SMALLEST_PERCENT = 0.2  # over the whole time; a plant's data cannot show a smaller change
SMALLEST_SHARE = 0.1  # of the size of an effect, over that time


@dataclass(frozen=True, kw_only=True)
class TrendOverWeeks:
    """The rate of S in percent of OP span a month, with its 95 % interval, over ``days``; or of
    another ``number`` in its ``unit``. ``smallest`` change over that time can be seen at all. ``J``
    is the trend of J beside that of S. ``unsettled``: S has fallen, and too few days ago to tell
    whether it stays there, so that nothing is foreseen and nothing denied."""

    per_month: float
    low: float
    high: float
    days: float
    number: str = "S"
    unit: str = PERCENT
    smallest: float = SMALLEST_PERCENT
    forecast: WearForecast | None = None
    J: TrendOverWeeks | None = None
    unsettled: bool = False

    @property
    def is_change(self) -> bool:
        """Whether the interval excludes 0 and the total change is large enough to be visible."""
        total_change = abs(self.per_month) * self.days / DAYS_A_MONTH
        return not self.low <= 0.0 <= self.high and total_change >= self.smallest

    @property
    def rate(self) -> Estimate:
        """The rate a month, with its interval."""
        unit = f"{self.unit}/month"
        return Estimate(value=self.per_month, low=self.low, high=self.high, unit=unit)

    def foresees_within(self, weeks: float) -> bool | None:
        """Whether S more likely than not reaches the limit within ``weeks``. ``None`` where that is
        uncertain: it may take up to twice as many, S rises and the date is not known, or S has just
        fallen."""
        if self.unsettled:
            return None
        if self.forecast is None:
            return False
        until = self.forecast.until.value
        if until is None:
            return None if self.forecast.probability_rises >= LIKELY_RISING else False
        return until <= weeks or (None if until <= 2.0 * weeks else False)

    @property
    def words(self) -> str:
        """The rate for a reader."""
        digits = 2
        if self.unit != PERCENT and self.per_month:
            digits = max(1 - math.floor(math.log10(abs(self.per_month))), 0)
        rate, low, high = (
            f"{value:+.{digits}f}" for value in (self.per_month, self.low, self.high)
        )
        text = f"{self.number} {rate} {self.unit} a month ({low} to {high})"
        text = text.replace("-", "\N{MINUS SIGN}").replace("  ", " ")
        foreseen = "" if self.forecast is None else self.forecast.words
        return f"{text}, {foreseen}" if foreseen and self.is_change else text


def trend_over_weeks(
    days: Sequence[float], values: Sequence[float], limit: float | None = None
) -> TrendOverWeeks | None:
    """The slope of ``values`` (n,) of S, a day's mean each, over ``days`` (n,), by least squares
    with Student's t for n - 2 degrees of freedom; ``None`` where there are too few days. With a
    ``limit``, percent, of S: over the days since S last fell, and where S rises towards the limit,
    the trend says when it will reach it. For another quantity than S, ``dataclasses.replace`` sets
    number and unit."""
    unsettled = False
    if limit is not None:
        present = history_since_fall(days, values)
        days, values, unsettled = present.days, present.S, present.unsettled
    t, y = np.asarray(days, dtype=np.float64), np.asarray(values, dtype=np.float64)
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
        unsettled=unsettled,
    )
    if limit is None or unsettled or not trend.is_change or slope <= 0.0:
        return trend
    return replace(trend, forecast=forecast_wear(days, values, limit))


def trend_of_size(name: str, by_day: Mapping[date, Estimate]) -> TrendOverWeeks | None:
    """The trend of a number of an effect, ``name`` in words, by its value on each day."""
    days, sizes = sorted(by_day), [by_day[day] for day in sorted(by_day)]
    values = [size.value for size in sizes if size.value is not None]
    if len(values) < len(days) or len({size.unit for size in sizes}) != 1:
        return None
    trend = trend_over_weeks([(day - days[0]).days for day in days], values)
    if trend is None:
        return None
    smallest = SMALLEST_SHARE * abs(float(np.mean(values)))
    return replace(trend, number=name, unit=sizes[0].unit, smallest=smallest)
