"""Round numbers and equal scales on the axes of plots."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.service.report.charts.axes import equally_long, next_round_number, ticks


@pytest.mark.parametrize(
    ("least", "expected"), [(0.21, 0.25), (1.0, 1.0), (2.1, 2.5), (2.6, 5.0), (51.0, 100.0)]
)
def test_the_next_round_number_holds_the_value(least: float, expected: float) -> None:
    """It is 1, 2, 2.5 or 5 times a power of ten, and the value itself where that is one."""
    assert next_round_number(least) == pytest.approx(expected, rel=1e-12)


@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6))
def test_ticks_lie_evenly_inside_their_axis(low: float, width: float) -> None:
    """At least one, at most eight, at equal steps."""
    result = ticks(low, low + width, about=6)
    assert 1 <= len(result) <= 8
    steps = np.diff(result)
    assert np.allclose(steps, steps[0]) if len(steps) else True
    assert all(low - 1e-6 * width <= item <= low + width * (1 + 1e-6) for item in result)


def test_an_end_of_the_axis_that_is_round_has_a_tick() -> None:
    """Though 0.3 is no whole number of tenths to a computer."""
    assert ticks(0.0, 0.3, 3) == pytest.approx([0.0, 0.1, 0.2, 0.3])


def test_one_percent_is_as_long_along_both_axes() -> None:
    """The shorter range is widened about its middle; the longer one stays."""
    assert equally_long((0.0, 10.0), (4.0, 6.0), 2.0) == ((0.0, 10.0), (2.5, 7.5))
    assert equally_long((4.0, 6.0), (0.0, 10.0), 2.0) == ((-5.0, 15.0), (0.0, 10.0))
