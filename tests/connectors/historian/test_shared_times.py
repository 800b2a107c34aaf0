"""Tags that share their times are laid on the clock as each would be alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.connectors.historian.columns import Column, own_interval_s, sharing_times
from stemwatch.connectors.historian.source_clock import lay_column, make_grid
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.models.recording import Quality, Role

RNG = np.random.default_rng(2)
EVEN = np.arange(400) * 10**9
CLOCKS = {
    "even": EVEN,
    "gap": np.concatenate((EVEN[:150], EVEN[150:] + 40 * 10**9)),
    "jitter": EVEN + RNG.integers(-(10**8), 10**8, EVEN.size),
    "stamped early": np.where(np.arange(400) == 200, EVEN[199], EVEN),
    "repeated": np.repeat(EVEN[:200], 2),
    "by exception": np.sort(RNG.choice(EVEN, 90, replace=False)),
}


def column(ns, tag) -> Column:
    quality = np.where(RNG.random(ns.size) < 0.05, Quality.BAD, Quality.GOOD).astype(np.uint8)
    values = np.where(quality == Quality.GOOD, np.round(RNG.standard_normal(ns.size), 1), np.nan)
    return Column(
        tag=tag,
        unit="%",
        description="",
        times=Timeline(ns),
        values=values,
        quality=quality,
        file_ns=ns,
    )


def test_equal_times_are_one_timeline():
    """Those of equal times get the first one's; others, also of the same length, keep theirs."""
    columns = {
        Role.OP: column(EVEN, "OP"),
        Role.MV: column(EVEN.copy(), "MV"),
        Role.PV: column(EVEN + 1, "PV"),
    }
    shared = sharing_times(columns)
    assert shared[Role.MV].times is columns[Role.OP].times
    assert shared[Role.PV].times is columns[Role.PV].times
    assert shared[Role.MV].values is columns[Role.MV].values


@pytest.mark.parametrize("name", CLOCKS)
@pytest.mark.parametrize("window", [(None, None), (20 * 10**9, 300 * 10**9)])
def test_columns_are_laid_as_each_alone(name, window):
    """Whatever the clock is like, the second of two tags is not taken for the first."""
    ns = CLOCKS[name]
    columns = {role: column(ns, role.value) for role in (Role.OP, Role.MV)}
    grid = make_grid(columns[Role.OP].times, "OP", "made", window)
    for role, item in sharing_times(columns).items():
        alone = replace(columns[role], times=Timeline(ns.copy()))
        result, expected = (lay_column(each, grid, is_clock=True) for each in (item, alone))
        np.testing.assert_array_equal(result.values, expected.values)
        np.testing.assert_array_equal(result.quality, expected.quality)
        assert result.decision == expected.decision
        assert result.values.size == grid.size
        # What is not on the grid is nowhere: every good number is one of the column's own.
        assert set(result.values[np.isfinite(result.values)]) <= set(item.values)
        assert own_interval_s(item, command=False) == own_interval_s(alone, command=False)
