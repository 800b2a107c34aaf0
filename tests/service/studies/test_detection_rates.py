"""The area under the ROC curve and its interval."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.service.studies.detection_rates import area_estimate


@pytest.mark.parametrize(
    ("bad", "good", "expected"),
    [([1.0, 2.0], [3.0], 1.0), ([3.0], [1.0, 2.0], 0.0), ([1.0, 3.0], [2.0, 3.0], 0.625)],
)
def test_the_area_is_the_share_of_pairs_in_order(bad, good, expected) -> None:
    """Every pair counts once, a tie half."""
    area = area_estimate(good, bad)
    assert expected == pytest.approx(area.value)
    assert area.low <= area.value <= area.high


def test_the_interval_of_a_perfect_area_is_not_empty() -> None:
    """At 1 the lower end solves 1 - A = 1.96 standard errors, and more valves bring it nearer."""
    few, several = (area_estimate(np.ones(n).tolist(), np.zeros(n).tolist()) for n in (5, 50))
    assert few.low < several.low < 1.0
    assert 1.0 == few.high == several.high
    A, n = several.low, 50
    variance = A * (1 - A) * (1 + (n - 1) * ((1 - A) / (2 - A) + A / (1 + A))) / n**2
    assert 1.0 - A == pytest.approx(1.959964 * np.sqrt(variance), rel=1e-6)


@given(
    bad=st.lists(st.floats(0, 9), min_size=1, max_size=30),
    good=st.lists(st.floats(0, 9), min_size=1, max_size=30),
)
@settings(max_examples=50, deadline=None)
def test_the_interval_holds_the_area_and_mirrors(bad, good) -> None:
    """Whatever the scores, 0 <= low <= area <= high <= 1, and changing sides gives 1 - area."""
    area, mirrored = area_estimate(good, bad), area_estimate(bad, good)
    assert 0.0 <= area.low <= area.value <= area.high <= 1.0
    assert 1.0 == pytest.approx(area.value + mirrored.value)


def test_an_empty_group_has_no_area() -> None:
    """Nothing is made up where nothing was scored."""
    assert "no valve of one group could be scored" in (area_estimate([1.0], []).reason or "")
