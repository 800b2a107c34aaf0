"""Limits from the scores of terms on valves with nothing hidden."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.service.studies.proof.nulls import common_limit, term_nulls

HUNDRED = [round(0.001 * k, 3) for k in range(100)]


def scores(**means: list[float]):
    """Terms with these means and a t that is always high enough."""
    return {slug: [(mean, 9.0) for mean in row] for slug, row in means.items()}


def test_the_common_limit_rests_on_the_highest_of_all_terms() -> None:
    """Two terms that are never high on the same valve double what chance may name."""
    limit = common_limit(scores(dead_time=HUNDRED), 2.0, 0.05)
    two = common_limit(scores(dead_time=HUNDRED, lost_motion=HUNDRED[::-1]), 2.0, 0.05)
    assert 0.1 == pytest.approx(limit.mean_limit)
    assert two.mean_limit >= limit.mean_limit
    assert (100, 100) == (limit.of, two.of)


def test_a_high_mean_with_a_low_t_is_no_alarm() -> None:
    """What fails the limit of t does not raise that of the mean."""
    rows = {"dead_time": [(0.5, 1.0)] * 50 + [(0.02, 3.0)] * 50}
    limit = common_limit(rows, 2.0, 0.01)
    assert 0.02 == pytest.approx(limit.mean_limit)
    assert 0 == limit.passing


def test_each_term_has_its_share_of_the_alarms() -> None:
    """With two terms each may pass half of the share; the one with the higher limit comes first."""
    high = [10.0 * mean for mean in HUNDRED]
    rows = term_nulls(scores(dead_time=HUNDRED, stem_creep=high), 2.0, 0.10)
    assert ["stem_creep", "dead_time"] == [row.slug for row in rows]
    assert 0.95 == pytest.approx(rows[0].limit)
    assert max(high) == pytest.approx(rows[0].mean[-1])
    assert 5 == sum(mean > rows[0].limit for mean in high) + 1


@given(
    means=st.lists(st.floats(0.0, 2.0), min_size=1, max_size=60),
    share=st.floats(0.001, 0.5),
)
def test_no_more_nulls_pass_than_may(means: list[float], share: float) -> None:
    """Whatever the scores are, at most the share of them lies above the limit."""
    limit = common_limit(scores(dead_time=means), 2.0, share)
    above = int(np.sum(np.array(means) > limit.mean_limit + 1e-9))
    assert above == limit.passing
    assert above <= share * len(means)
