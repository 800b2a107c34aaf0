"""Across a plant: which findings stand at a false discovery rate, and that the rate is kept."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.models.statistics.false_discovery import LEVEL, significant

LEVELS = st.sampled_from([0.01, LEVEL, 0.1, 0.5])
# Few values, so that ties are common; and any value at all.
P_VALUES = st.one_of(
    st.none(), st.sampled_from([0.0, 0.001, 0.01, 0.0125, 0.025, 0.05, 0.5, 1.0]), st.floats(0, 1)
)


def plainly(p_values, level):
    """Benjamini and Hochberg as they state it: the largest rank k that has k values at or below
    ``level k / m``, and whatever is at or below that limit."""
    m = len(p_values)
    known = [p for p in p_values if p is not None]
    limits = [level * k / m for k in range(1, m + 1)]
    kept = [limit for k, limit in enumerate(limits, 1) if sum(p <= limit for p in known) >= k]
    return [p is not None and bool(kept) and p <= kept[-1] for p in p_values]


@given(p_values=st.lists(P_VALUES, max_size=30), level=LEVELS)
def test_it_is_the_procedure_of_benjamini_and_hochberg(p_values, level):
    """The sorted form and the definition agree; what has no p value never stands."""
    assert significant(p_values, level) == plainly([*p_values], level)


def test_a_case_that_can_be_checked_by_hand():
    """Of ten valves the limits are 0.005, 0.010, 0.015 ...: the third is above its own, and stands
    all the same because the fourth is below."""
    p_values = [0.004, 0.019, 0.016, 0.009, 0.030, 0.5, None, None, None, None]
    assert [k for k, item in enumerate(significant(p_values, 0.05)) if item] == [0, 1, 2, 3]


def test_without_findings_nothing_stands():
    """No valve at all, and valves of which none has anything named."""
    assert significant([]) == []
    assert significant([None, None, None]) == [False, False, False]


def test_equal_p_values_stand_or_fall_together():
    """Four at 0.02 stand among ten valves and fall among eleven, all of them."""
    assert significant([0.02] * 4 + [None] * 6) == [True] * 4 + [False] * 6
    assert significant([0.02] * 4 + [None] * 7) == [False] * 11


@given(p_values=st.lists(P_VALUES, min_size=1, max_size=20), seed=st.integers(0, 99))
def test_the_order_of_the_valves_does_not_matter(p_values, seed):
    """Each valve keeps its answer when the plant is listed in another order."""
    order = np.random.default_rng(seed).permutation(len(p_values))
    stood = significant(p_values)
    assert significant([p_values[k] for k in order]) == [stood[k] for k in order]


@given(p_values=st.lists(P_VALUES, max_size=20), more=st.integers(1, 200))
def test_more_valves_with_nothing_named_never_help(p_values, more):
    """What stands among many stands among few: a valve that was looked at counts."""
    among_many = significant([*p_values, *[None] * more])[: len(p_values)]
    alone = significant(p_values)
    assert all(few or not several for few, several in zip(alone, among_many, strict=True))


def test_the_share_of_false_findings_is_at_most_the_level():
    """Ten real effects and forty valves with nothing hidden, many times over: on average at most
    5 % of what stands is false, while most of the real stands."""
    rng = np.random.default_rng(8)
    shares, real = [], []
    for _ in range(2000):
        chance = np.where((p := rng.random(40)) <= 0.025, p, np.nan)  # named at p <= 0.025 only
        p_values = [*rng.uniform(0.0, 0.008, 10), *(None if np.isnan(p) else p for p in chance)]
        stood = significant(p_values)
        shares.append(sum(stood[10:]) / max(sum(stood), 1))
        real.append(sum(stood[:10]))
    assert np.mean(shares) <= LEVEL
    assert np.mean(real) > 8.0
