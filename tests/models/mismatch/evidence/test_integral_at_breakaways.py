"""A positioner that integrates is told from the breakaways of its stem."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.evidence.integral_at_breakaways import (
    NOTHING_SEEN,
    IntegralAtBreakaways,
    integral_at_breakaways,
)
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.onsets import onsets

S, J, SIGMA = 5.0, 2.0, 0.03
LEVEL, SLIDING = 0.5 * (S + J), 0.5 * (S - J)
N = 3600


def command(seed: int) -> Floats:
    """A loop's OP: waves of some minutes that wander."""
    rng = np.random.default_rng(seed)
    t = np.arange(N)
    wave = 6.0 * np.sin(2.0 * np.pi * t / 170.0) + 3.0 * np.sin(2.0 * np.pi * t / 411.0)
    return np.asarray(50.0 + wave + np.cumsum(0.05 * rng.normal(size=N)))


def stem(op: Floats, rate: float, zone: float, seed: int, scatter: float = 0.06) -> Floats:
    """A stem by S and J whose breakaways scatter, behind a positioner that integrates; in equations
    written here, with noise."""
    rng = np.random.default_rng(seed)
    x, integral, share, out = op[0], 0.0, 1.0, np.empty(op.size)
    for k, asked in enumerate(op):
        if abs(asked - x) > zone:
            integral += rate * (asked - x)
        force = asked + integral - x
        if abs(force) > share * LEVEL:
            x = asked + integral - np.sign(force) * SLIDING
            share = 1.0 + scatter * rng.normal()
        out[k] = x
    return np.asarray(out + SIGMA * rng.normal(size=op.size))


def read(op: Floats, mv: Floats) -> IntegralAtBreakaways:
    every = np.ones(op.size, dtype=bool)
    return integral_at_breakaways(op, mv, every, onsets(mv, every, SIGMA, 1.0), 1.0)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(15.0, 60.0), st.floats(0.1, 0.7))
def test_the_integral_is_seen(seed: int, period_s: float, share: float) -> None:
    """Its time within a factor of two, whatever the dead zone below the level."""
    op = command(seed)
    seen = read(op, stem(op, 1.0 / period_s, share * LEVEL, seed + 1))
    assert seen.shows
    assert 0.5 * period_s < 1.0 / seen.rate < 2.0 * period_s


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.0, 0.12))
def test_a_positioner_without_an_integral_shows_none(seed: int, scatter: float) -> None:
    """However much the breakaways scatter."""
    op = command(seed)
    assert not read(op, stem(op, 0.0, 0.0, seed + 1, scatter)).shows


def test_without_breakaways_nothing_is_said() -> None:
    """A stem that stands has none."""
    op = command(1)
    assert read(op, np.full(N, 50.0)) == NOTHING_SEEN
