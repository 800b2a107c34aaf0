"""What sticking costs a loop: in variance, and in money where there is a price."""

from __future__ import annotations

import pytest

from stemwatch.models.screening_result import Indicator
from stemwatch.service.presenter.cost_of_sticking import (
    CostOfSticking,
    Prices,
    cost_of_sticking,
    total,
    total_in_words,
)


def indicator(name: str, value: float, low: float, high: float, unit: str = "%") -> Indicator:
    """An indicator with its interval."""
    return Indicator(name=name, value=value, unit=unit, meaning="", low=low, high=high)


FOUND = {
    one.name: one
    for one in (
        indicator("variance_from_sticking_percent", 80.0, 70.0, 85.0),
        indicator("control_error_std", 2.0, 2.0, 2.0, "t/h"),
        indicator("control_error_std_repaired", 0.9, 0.8, 1.1, "t/h"),
        indicator("control_error_from_sticking", 0.5, 0.4, 0.7, "t/h"),
        indicator("off_target_from_sticking_percent", 20.0, 10.0, 30.0),
        indicator("travel_from_sticking_per_hour_percent", -50.0, -80.0, 100.0),
    )
}


def cost(prices: Prices | None) -> CostOfSticking:
    """The cost of the indicators above."""
    told = cost_of_sticking(FOUND, prices, "EUR")
    assert told is not None
    return told


def test_without_a_price_it_is_variance() -> None:
    """The share with its interval, and both standard deviations in PV's unit."""
    told = cost(None)
    assert told.sentence == (
        "The sticking causes 80 % of the variance of SP - PV (90 % interval 70 to 85 %): with a "
        "valve that does not stick its standard deviation would be 0.90 instead of 2.0 t/h."
    )
    assert told.money.value is None
    assert cost_of_sticking({}, Prices(per_unit_hour=1.0)) is None


def test_no_share_is_claimed_where_the_interval_holds_zero() -> None:
    """A loop that would as likely become worse: both ends in words, neither a size nor money, and
    no part in the plant's total."""
    share = indicator("variance_from_sticking_percent", 98.0, -64.0, 99.0)
    told = cost_of_sticking(
        {**FOUND, share.name: share}, Prices(per_unit_hour=10.0), currency="EUR"
    )
    assert told is not None
    assert told.sentence == (
        "What the sticking costs this loop cannot be told: with a valve that does not stick, the "
        "variance of SP - PV would lie between 64 % larger and 99 % smaller (90 % interval)."
    )
    assert (told.money.value, told.a_month) == (None, "")
    assert "cannot be told" in str(told.money)
    priced = cost(Prices(per_unit_hour=10.0))
    assert total_in_words({"A": told, "B": priced}) == total_in_words({"B": priced})
    assert total_in_words({"A": told}) == ""


def test_each_price_is_for_what_it_says() -> None:
    """730 hours a month: a unit of deviation, a share of the time, full strokes; ends add up."""
    money = cost(Prices(per_unit_hour=10.0)).money
    assert [money.value, money.low, money.high] == pytest.approx([3650.0, 2920.0, 5110.0])
    assert money.unit == "EUR"
    assert cost(Prices(per_hour_off_target=100.0)).money.value == pytest.approx(14_600.0)
    worse = cost(Prices(per_stroke=2.0)).money
    assert [worse.value, worse.high] == pytest.approx([-730.0, 1460.0])
    both = cost(Prices(per_unit_hour=10.0, per_stroke=2.0))
    assert both.money.value == pytest.approx(2920.0)
    assert both.sentence.endswith("That is 2,920 EUR (1,752 to 6,570) a month.")


def test_the_plants_total_has_independent_doubts() -> None:
    """Four equal loops: four times the money, twice the doubt; loops without a price are left
    out."""
    one = cost(Prices(per_unit_hour=10.0))
    four = total([one] * 4)
    assert four.value == pytest.approx(4 * 3650.0)
    assert four.value - four.low == pytest.approx(2 * 730.0)
    costs = {"A": one, "B": cost(None)}
    assert total_in_words(costs) == (
        "The sticking of 1 loop costs about 3,650 EUR (2,920 to 5,110) a month."
    )
    assert total_in_words({"B": cost(None)}) == ""
