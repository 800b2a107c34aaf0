"""A stem that gives way to its command while it rests is told from one that does not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.evidence.giving_at_rest import GivingAtRest, giving_at_rest
from stemwatch.models.mismatch.stem_model.presliding import given_way
from stemwatch.models.recording import Floats

S, J, SIGMA = 5.0, 1.0, 0.02
LEVEL, SLIDING = 0.5 * (S + J), 0.5 * (S - J)
N = 3000


def command(seed: int) -> Floats:
    """A loop's OP: waves of about two minutes with noise of 0.1 %."""
    rng = np.random.default_rng(seed)
    t = np.arange(N)
    wave = 8.0 * np.sin(2.0 * np.pi * t / 120.0) + 3.0 * np.sin(2.0 * np.pi * t / 411.0)
    return np.asarray(50.0 + wave + 0.1 * rng.normal(size=N))


def stem(op: Floats, gives: float, level: float = LEVEL) -> Floats:
    """A stem by S and J, which gives way at rest; in equations written here."""
    x, before, out = op[0], 0.0, np.empty(op.size)
    for k, asked in enumerate(op):
        force = asked - x
        if abs(force) > level:
            x = asked - np.sign(force) * SLIDING
        else:
            x += given_way(before, force, level, gives)
        before = asked - x
        out[k] = x
    return out


def read(op: Floats, mv: Floats, simulated: Floats) -> GivingAtRest:
    every = np.ones(op.size, dtype=bool)
    return giving_at_rest(op, mv, simulated, every, 1.0, SIGMA, S, J)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.01, 0.04))
def test_what_it_gives_is_read_from_the_rests(seed: int, gives: float) -> None:
    """Within a third, although the simulated stem stands still and slips at other places."""
    op = command(seed)
    mv = stem(op, gives) + SIGMA * np.random.default_rng(seed + 1).normal(size=N)
    seen = read(op, mv, stem(op, 0.0))
    assert seen.shows
    assert seen.c == pytest.approx(gives, rel=0.35)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.9, 1.1))
def test_a_stem_that_stands_still_does_not_give_way(seed: int, lets_go: float) -> None:
    """Also where it lets go sooner or later than the simulated one, which shifts all its slips."""
    op = command(seed)
    mv = stem(op, 0.0, lets_go * LEVEL) + SIGMA * np.random.default_rng(seed + 1).normal(size=N)
    seen = read(op, mv, stem(op, 0.0))
    assert abs(seen.c) < 0.005


def test_without_rests_nothing_is_said() -> None:
    """A stem that follows its command all the time has no rest to read."""
    op = command(1)
    assert read(op, op, op) == GivingAtRest(0.0, 0.0, 0)
