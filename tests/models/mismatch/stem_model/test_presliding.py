"""A stem gives way to the force before it lets go, as LuGre's bristles do."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.presliding import given_way
from stemwatch.models.mismatch.stem_model.stem import Stem
from tests.models.mismatch.fitted_chain import followed

LEVEL = 3.0  # percent


def by_bristles(forces: list[float], gives: float, steps: int = 4000) -> float:
    """How far LuGre's bristles let a stem move, percent, while the force on it takes these values
    one after the other: ``z' = v - |v| z / (level gives)``, the force on the stem ``z / gives``.
    """
    x, bent = 0.0, gives * forces[0]
    for before, after in pairwise(forces):
        for part in range(steps):
            force = before + (after - before) * (part + 1) / steps - x
            change = gives * force - bent
            side = np.sign(change)
            # The bristles bend by ``change`` while the stem moves by this.
            x += change / (1.0 - side * bent / (LEVEL * gives))
            bent = gives * force
    return x


@settings(max_examples=30)
@given(
    st.lists(st.floats(-0.9 * LEVEL, 0.9 * LEVEL), min_size=2, max_size=4), st.floats(0.005, 0.05)
)
def test_a_stem_gives_way_as_on_bristles(forces: list[float], gives: float) -> None:
    """Under a force that goes to and fro below the level."""
    moved = 0.0
    for before, after in pairwise(forces):
        moved += given_way(before - moved, after - moved, LEVEL, gives)
    way = sum(abs(after - before) for before, after in pairwise(forces))
    assert moved == pytest.approx(by_bristles(forces, gives), abs=0.25 * gives * way + 1e-6)


@given(st.floats(-10.0, 10.0), st.floats(-10.0, 10.0), st.floats(0.0, 0.3))
def test_it_never_moves_further_than_the_force(before: float, force: float, gives: float) -> None:
    """Towards the force, whatever that is; a packing that does not give holds it."""
    way = given_way(before, force, LEVEL, gives)
    assert 0.0 <= way * np.sign(force - before) <= abs(force - before)
    assert way == pytest.approx(-given_way(-before, -force, LEVEL, gives))
    assert gives > 0.0 or way == 0.0


def resting(swing: float, gives: float, samples: int = 400) -> np.ndarray:
    """The reading of a stem under a command that swings at 2 % above it, below its level."""
    stem = Stem.neutral(samples, 1.0)
    stem.numbers[[stem_number.S, stem_number.J]] = 5.0, 1.0
    stem.numbers[stem_number.GIVES] = gives
    command = 52.0 + swing * (np.arange(samples) % 2 - 0.5)
    command[0] = 52.0
    marks = np.zeros(samples, dtype=np.uint8)
    marks[0] = 1
    never = np.full(samples, samples)
    out, _, _ = followed(stem, command, np.full(samples, 50.0), marks, (never, never))
    return np.asarray(out)


def test_a_resting_stem_creeps_towards_a_command_that_swings() -> None:
    """Not under one that stands, and the more the larger the swing; always short of it."""
    still, small, large = (resting(swing, 0.02) for swing in (0.0, 0.2, 0.6))
    assert np.ptp(still) == 0.0
    assert 0.2 < small[-1] - 50.0 < large[-1] - 50.0 < 2.0
    assert np.ptp(resting(0.6, 0.0)) == 0.0


def test_the_run_moves_by_what_each_change_of_the_command_gives() -> None:
    """Sample by sample, in equations written here."""
    seen, x, before = resting(0.4, 0.03, 60), 50.0, 52.0
    for k in range(1, 60):
        command = 52.0 + 0.4 * (k % 2 - 0.5)
        x += given_way(before - x, command - x, LEVEL, 0.03)
        assert seen[k] == pytest.approx(x, abs=1e-9)
        before = command
