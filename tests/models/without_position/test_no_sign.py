"""The S that would have shown, and the regression that it is from."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.models.statistics.quantile_regression import quantile_regression
from stemwatch.models.without_position.no_sign import LEAST_SHARE, NoSignLimit, columns, logit
from stemwatch.models.without_position.suspicion import trained_judge

LIMIT = NoSignLimit(
    level=1.0, by_swings=0.5, by_range=-0.5, by_S=1.5, beyond=-1.0, by_amplitude=0.5
)


@given(st.floats(0.0, 1.0), st.floats(4.0, 300.0), st.floats(1.0, 3.0), st.floats(0.2, 30.0))
def test_of_the_S_that_is_named_and_of_all_larger_ones_nine_of_ten_score_above(
    score, swings, range_share, amplitude
) -> None:
    """Up to OP's range; and where no S is named, that is not true of S at OP's amplitude."""
    for limit in (LIMIT, trained_judge().limits.no_sign):
        share = limit.shows_from(score, swings, range_share, amplitude)
        shares = np.linspace(1.0 if share is None else share, range_share, 50)
        covariates = (np.full(50, value) for value in (swings, range_share, amplitude))
        above = columns(shares, *covariates) @ np.array(astuple(limit)) >= logit(score) - 1e-9
        assert above.all() == (share is not None)
        assert share is None or LEAST_SHARE <= share <= 1.0 + 1e-9


def test_a_lower_score_and_more_swings_show_a_smaller_S() -> None:
    """And swings that are uneven a larger one; above sixteen swings nothing changes."""
    limit = trained_judge().limits.no_sign
    named = [limit.shows_from(score, 10.0, 1.3) for score in (0.3, 0.5, 0.7)]
    assert named == sorted(named)
    assert len(set(named)) == len(named)
    swings = [limit.shows_from(0.4, n, 1.3) for n in (16.0, 8.0, 5.0)]
    assert swings == sorted(swings)
    assert limit.shows_from(0.4, 16.0, 1.3) == limit.shows_from(0.4, 100.0, 1.3)
    assert limit.shows_from(0.4, 10.0, 1.1) < limit.shows_from(0.4, 10.0, 2.0)
    # the same share of a wider swing is a larger S, which the score asks for
    assert limit.shows_from(0.4, 10.0, 1.3, 8.0) < limit.shows_from(0.4, 10.0, 1.3, 3.0)
    assert limit.shows_from(0.4, 10.0, 1.3, 8.0) == limit.shows_from(0.4, 10.0, 1.3, 30.0)


def test_where_a_larger_S_shows_no_better_nothing_is_named() -> None:
    """A limit that was fitted to nothing says nothing, at any score."""
    none = NoSignLimit(0.0, 0.0, 0.0, by_S=0.0, beyond=0.0, by_amplitude=0.0)
    assert none.shows_from(0.0, 20.0, 1.0) is None
    assert LIMIT.shows_from(0.999, 20.0, 1.0) is None


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_share_of_what_was_observed_lies_below_the_plane(share) -> None:
    """Scatter that grows along x: its quantile is another line than its mean."""
    rng = np.random.default_rng(4)
    x = rng.uniform(0.0, 2.0, 2000)
    observed = 1.0 + 2.0 * x + (0.5 + x) * rng.uniform(0.0, 1.0, x.size)
    weights = quantile_regression(np.column_stack([np.ones(x.size), x]), observed, share)
    assert weights == pytest.approx([1.0 + 0.5 * share, 2.0 + share], abs=0.12)
    below = observed < weights[0] + weights[1] * x
    assert np.mean(below) == pytest.approx(share, abs=0.005)
