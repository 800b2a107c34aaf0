"""Traces as letters: what a page, its script and the store read back."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.service.report.charts.traces import GAP, packed, packed_indices, unpacked

VALUES = st.lists(
    st.one_of(st.floats(-1e9, 1e9, allow_subnormal=False), st.just(float("nan"))), max_size=80
)


@given(values=VALUES)
def test_a_trace_comes_back_to_half_a_step(values):
    """Gaps where they were, and every value rounded to the digits that are kept."""
    trace = packed(np.array(values, dtype=np.float64))
    back = unpacked(trace)
    np.testing.assert_allclose(back, values, rtol=1e-9, atol=0.500001 / trace["per"])


def test_the_letters_are_those_of_source_maps():
    """1, 15, 16 and -1 with a gap of three: 2, 30, 32 and 1 in groups of five bits."""
    values = np.array([1.0, 16.0, np.nan, np.nan, np.nan, 32.0, 31.0])
    trace = packed(values)
    assert trace["per"] == 100
    whole = packed_indices(np.array([1, 16, 32]))
    assert whole == {"per": 1, "steps": "CegB"}
    assert trace["steps"].count(GAP) == 1
    assert f"{GAP}G" in trace["steps"]
    np.testing.assert_array_equal(unpacked(trace), values)


def test_pictures_of_an_earlier_store_can_be_read():
    """They hold the steps as a list."""
    earlier = unpacked({"per": 10, "steps": [None, 5, None, -3]})
    np.testing.assert_array_equal(earlier, [np.nan, 0.5, np.nan, 0.2])


@pytest.mark.parametrize("empty", [np.zeros(0), np.full(3, np.nan)])
def test_nothing_known_is_no_step(empty):
    """A trace without samples stays as long as it was."""
    np.testing.assert_array_equal(unpacked(packed(empty)), empty)
