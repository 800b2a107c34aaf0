"""A number with an interval, or the reason why there is none."""

from __future__ import annotations

import pytest

from stemwatch.models.estimate import Estimate


def test_either_a_value_or_a_reason():
    """Neither both nor none of value and reason is an estimate."""
    with pytest.raises(ValueError, match="either a value or a reason"):
        Estimate()
    with pytest.raises(ValueError, match="either a value or a reason"):
        Estimate(value=1.0, reason="too short")


def test_the_interval_is_in_order():
    """A low end above the high end is refused with both numbers."""
    with pytest.raises(ValueError, match=r"low <= high, received 2.0 > 1.0"):
        Estimate(value=1.5, low=2.0, high=1.0)


def test_unknown_keeps_the_reason():
    """An unknown estimate has no number, and says why when printed."""
    estimate = Estimate.unknown("OP did not move", unit="%")
    assert estimate.value is None
    assert "not known: OP did not move" == str(estimate)


def test_prints_value_interval_and_unit():
    """A known estimate prints three digits, its interval and its unit."""
    assert "4.98 (4.39 to 5.50) %" == str(Estimate(value=4.981, low=4.39, high=5.5, unit="%"))
    assert "2" == str(Estimate(value=2.0))


def test_intervals_that_have_nothing_in_common_contradict_each_other():
    """Intervals that touch do not contradict each other, nor does one with an unknown end."""
    first, second = Estimate(value=2.0, low=1.0, high=3.0), Estimate(value=4.0, low=3.5, high=5.0)
    assert first.contradicts(second)
    assert second.contradicts(first)
    assert not first.contradicts(Estimate(value=3.5, low=3.0, high=4.0))
    assert not first.contradicts(Estimate(value=9.0))


def test_an_estimate_that_holds_others_keeps_its_value():
    """Its interval grows to theirs, and by nothing where theirs are not known."""
    first, second = Estimate(value=2.0, low=1.0, high=3.0), Estimate(value=4.0, low=3.5, high=5.0)
    assert first.holding(second) == Estimate(value=2.0, low=1.0, high=5.0)
    assert first.holding(Estimate(value=9.0)) == first
