"""The cost of a sticking valve to its loop, in variance and travel, and in money where the plant
file has a price.

The numbers are indicators of the screening (``indicators.of_repair``): the loop run again with a
valve that does not stick.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from math import sqrt
from typing import TYPE_CHECKING

from stemwatch.models.estimate import Estimate
from stemwatch.service.presenter.wording import figure

if TYPE_CHECKING:  # the plant file knows prices, and reading it loads no kernels
    from stemwatch.models.screening_result import Indicator

HOURS_A_MONTH = 730.0
SHARE = "variance_from_sticking_percent"
STD, REPAIRED = "control_error_std", "control_error_std_repaired"
# The indicator that each price applies to, and how many of its units make one unit of the price.
PRICED = {
    "per_unit_hour": ("control_error_from_sticking", 1.0),
    "per_hour_off_target": ("off_target_from_sticking_percent", 100.0),
    "per_stroke": ("travel_from_sticking_per_hour_percent", 100.0),
}
MADE_BY_STICKING = (SHARE, STD, REPAIRED, *(name for name, _ in PRICED.values()))


class RankBy(StrEnum):
    """What the order of a report goes by."""

    VERDICT = "verdict"
    COST = "cost"


@dataclass(frozen=True, kw_only=True)
class Prices:
    """Money for an hour with PV one unit away from SP, for an hour off target, and for a stem's
    travel of one full stroke; ``None`` where it costs nothing or nobody knows."""

    per_unit_hour: float | None = None
    per_hour_off_target: float | None = None
    per_stroke: float | None = None


@dataclass(frozen=True, kw_only=True)
class CostOfSticking:
    """``share`` of the variance of SP - PV in percent; ``money`` a month, unknown without a price
    and where nobody can say that the sticking costs anything."""

    share: Estimate
    std: float | None
    repaired: Estimate
    money: Estimate
    currency: str = ""

    @property
    def is_money(self) -> bool:
        """Whether a price says what it costs."""
        return self.money.value is not None

    @property
    def a_month(self) -> str:
        """The money with its interval; empty where no price says it."""
        return money_in_words(self.money, self.currency) if self.is_money else ""

    @property
    def sentence(self) -> str:
        """Both in one or two sentences; neither a size nor money where the cost cannot be told."""
        share = self.share
        if not can_be_told(share):
            return (
                "What the sticking costs this loop cannot be told: with a valve that does not "
                "stick, the variance of SP - PV would lie between "
                f"{_change(share.low)} and {_change(share.high)} (90 % interval)."
            )
        said = (
            f"The sticking causes {_percent(share.value)} % of the variance of SP - PV "
            f"(90 % interval {_percent(share.low)} to {_percent(share.high)} %): with a valve "
            "that does not stick its standard deviation would be "
            f"{figure(self.repaired.value, 2)} instead of {figure(self.std, 2)} "
            f"{self.repaired.unit}."
        )
        return f"{said} That is {self.a_month} a month." if self.is_money else said


def can_be_told(share: Estimate) -> bool:
    """Whether anybody can say that a repair would help: the interval of ``share`` lies above
    zero."""
    return share.low is None or share.low > 0.0


def money_in_words(money: Estimate, currency: str) -> str:
    """An amount with its 90 % interval."""
    value, low, high = (
        f"{round(amount or 0.0):,}" for amount in (money.value, money.low, money.high)
    )
    return f"{value} {currency} ({low} to {high})".replace("  ", " ")


def cost_of_sticking(
    indicators: Mapping[str, Indicator], prices: Prices | None, currency: str = ""
) -> CostOfSticking | None:
    """The cost of the sticking from the ``indicators`` of a screening; ``None`` where the loop
    could not be simulated without it."""
    share, repaired = indicators.get(SHARE), indicators.get(REPAIRED)
    if share is None or repaired is None:
        return None
    std, of_variance = indicators.get(STD), _estimate(share)
    return CostOfSticking(
        share=of_variance,
        std=None if std is None else std.value,
        repaired=_estimate(repaired),
        money=_money(indicators, prices, currency)
        if can_be_told(of_variance)
        else Estimate.unknown("what the sticking costs this loop cannot be told", currency),
        currency=currency,
    )


def money_of(costs: Mapping[str, CostOfSticking]) -> dict[str, float]:
    """What each valve costs a month, those left out of which nobody knows."""
    return {
        valve: cost.money.value for valve, cost in costs.items() if cost.money.value is not None
    }


def total_in_words(costs: Mapping[str, CostOfSticking]) -> str:
    """What the sticking of all valves, by their ids, costs a month; empty without a price."""
    priced = [cost for cost in costs.values() if cost.money.value is not None]
    if not priced:
        return ""
    loops = "1 loop costs" if len(priced) == 1 else f"{len(priced)} loops costs"
    return f"The sticking of {loops} about {money_a_month(costs)} a month."


def money_a_month(costs: Mapping[str, CostOfSticking]) -> str:
    """That amount with its interval; empty without a price."""
    priced = [cost for cost in costs.values() if cost.money.value is not None]
    return money_in_words(total(priced), priced[0].currency) if priced else ""


def total(costs: Iterable[CostOfSticking]) -> Estimate:
    """The sum of all known costs a month; the errors of different loops count as independent."""
    known = [cost.money for cost in costs if cost.money.value is not None]
    if not known:
        return Estimate.unknown("no loop has a price")
    value = sum(cost.value or 0.0 for cost in known)
    below = sqrt(sum(((cost.value or 0.0) - (cost.low or 0.0)) ** 2 for cost in known))
    above = sqrt(sum(((cost.high or 0.0) - (cost.value or 0.0)) ** 2 for cost in known))
    return Estimate(value=value, low=value - below, high=value + above, unit=known[0].unit)


def _money(indicators: Mapping[str, Indicator], prices: Prices | None, currency: str) -> Estimate:
    """The prices times the deviations caused by sticking. They come from one simulation, so the
    ends of their intervals add up."""
    if prices is None:
        return Estimate.unknown("the plant file has no price for this loop", currency)
    value, low, high, known = 0.0, 0.0, 0.0, False
    for name, (indicator, units) in PRICED.items():
        price, made = getattr(prices, name), indicators.get(indicator)
        if price is None or made is None or made.low is None or made.high is None:
            continue
        hourly = HOURS_A_MONTH * price / units
        value += hourly * made.value
        low, high = low + hourly * made.low, high + hourly * made.high
        known = True
    if not known:
        return Estimate.unknown("what the price is paid for is not known of this loop", currency)
    return Estimate(value=value, low=low, high=high, unit=currency)


def _estimate(indicator: Indicator) -> Estimate:
    return Estimate(
        value=indicator.value, low=indicator.low, high=indicator.high, unit=indicator.unit
    )


def _change(share: float | None) -> str:
    """How much smaller or larger a variance is without ``share`` percent of it."""
    if share is None:
        return "?"
    return f"{abs(share):.0f} % {'larger' if share < 0.0 else 'smaller'}"


def _percent(value: float | None) -> str:
    return "?" if value is None else f"{value:.0f}"
