"""Medians and percentiles are numpy's to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from stemwatch.models.statistics.quantiles import median, percentiles

arrays = npst.arrays(
    np.float64,
    st.integers(1, 60),
    elements=st.floats(-1e6, 1e6) | st.sampled_from([0.0, 0.1, 0.1, 7.0]),
)


@settings(max_examples=200, deadline=None)
@given(arrays)
def test_median_is_that_of_numpy(values):
    """Odd or even, with ties or without."""
    assert np.median(values) == median(values)


@settings(max_examples=200, deadline=None)
@given(arrays, st.lists(st.sampled_from([0.0, 1.0, 10.0, 50.0, 90.0, 99.0, 100.0]), max_size=4))
def test_percentiles_are_those_of_numpy(values, percents):
    """One or several, the ends included, also of a single sample."""
    percents = sorted(percents)
    expected = [np.percentile(values, percent) for percent in percents]
    assert expected == percentiles(values, percents)


@pytest.mark.parametrize("count", [86_399, 86_400])
def test_a_day_of_samples_stays_as_it_is(count):
    """Long signals take the vectorised way to the same numbers, and are not reordered."""
    values = np.random.default_rng(count).standard_normal(count)
    before = values.copy()
    assert np.median(values) == median(values)
    assert np.percentile(values, (1.0, 99.0)).tolist() == percentiles(values, (1.0, 99.0))
    np.testing.assert_array_equal(before, values)
