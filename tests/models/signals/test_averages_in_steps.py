"""Averages and samples, told apart by steps of a set point or of an OP in manual."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import stemwatch
from stemwatch.models.recording import Floats
from stemwatch.models.signals.averages_in_steps import keeps_averages, steps_from_rest

SCANS = 24 * 600


def set_point(seed: int, moves: int = 24) -> Floats:
    """(SCANS,) percent each second: set anew at once at ``moves`` times, each for long enough."""
    rng = np.random.default_rng(seed)
    long = SCANS // moves
    begin = np.arange(moves) * long + rng.integers(0, long // 3, moves)
    levels = np.cumsum(rng.choice((-1.0, 1.0), moves) * rng.uniform(1.0, 5.0, moves))
    return 50.0 + levels[np.searchsorted(begin[1:], np.arange(SCANS), side="right")]


def stored(values: Floats, scans: int, *, averaged: bool) -> Floats:
    rows = values[: values.size // scans * scans].reshape(-1, scans)
    return rows.mean(axis=1) if averaged else rows[:, 0].copy()


def recording(sp: Floats, scans: int, *, averaged: bool) -> stemwatch.Recording:
    """A noisy OP and its position beside a set point, kept so."""
    rng = np.random.default_rng(1)
    op = 50.0 + np.cumsum(rng.normal(0.0, 0.05, sp.size)) + rng.normal(0.0, 0.4, sp.size)
    kept = {
        name: stored(values, scans, averaged=averaged)
        for name, values in {"op": op, "mv": op, "pv": op, "sp": sp}.items()
    }
    return stemwatch.read(**kept, interval_s=float(scans), valve="FIC-1")


@given(seed=st.integers(0, 2**31), scans=st.sampled_from((10, 20, 30, 60)))
def test_steps_of_a_set_point_tell_what_the_archive_keeps(seed, scans):
    """A step is never between two levels in a sample, and nearly always in an average."""
    sp = set_point(seed)
    samples = steps_from_rest(stored(sp, scans, averaged=False), np.ones(SCANS // scans, bool))
    assert samples.averages is False
    averages = steps_from_rest(stored(sp, scans, averaged=True), np.ones(SCANS // scans, bool))
    assert averages.averages in (True, None)
    assert averages.between > averages.at_once


@pytest.mark.parametrize("averaged", [True, False])
def test_a_recording_is_told_by_its_set_point_beside_a_noisy_op(averaged):
    """OP is never at rest in automatic, and says nothing."""
    assert keeps_averages(recording(set_point(3), 10, averaged=averaged)) is averaged


def test_nothing_is_told_without_steps():
    """A set point that rests, and an OP that is never at rest."""
    assert keeps_averages(recording(np.full(SCANS, 50.0), 10, averaged=True)) is None
    assert keeps_averages(recording(set_point(3, moves=3), 10, averaged=True)) is None


def test_a_set_point_on_a_ramp_is_no_step():
    """A ramp of many rows leaves it open; it would be there in samples as well."""
    ramped = np.convolve(set_point(4), np.ones(120) / 120.0, "same")
    assert keeps_averages(recording(ramped, 10, averaged=False)) is None


def test_steps_across_a_gap_do_not_count():
    """Two levels with a bad value between may be any."""
    sp = stored(set_point(5), 10, averaged=False)
    changed = np.flatnonzero(np.diff(sp)) + 1
    usable = np.ones(sp.size, dtype=bool)
    usable[changed] = False
    assert steps_from_rest(sp, usable).averages is None
