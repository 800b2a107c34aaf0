"""Different values are counted up to a number, as by sorting all of them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.models.statistics.distinct import distinct


@given(
    st.lists(st.sampled_from([-1.0, -0.0, 0.0, 0.5, 100.0, np.inf]), max_size=20),
    st.integers(min_value=0, max_value=6),
)
def test_as_many_as_sorting_finds_up_to_the_most(values: list[float], most: int) -> None:
    """Zero with either sign is one value; of more than the most there is one more than these."""
    array = np.array(values, dtype=np.float64)
    assert distinct(array, most) == min(np.unique(array).size, most + 1)
