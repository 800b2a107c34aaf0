"""The integral of a positioner lets a resting stem go, and hunts where there is no dead zone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.integral_action import integral_after
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.recording import Floats
from tests.models.mismatch.fitted_chain import followed

S, J = 5.0, 1.0
LEVEL, SLIDING = 0.5 * (S + J), 0.5 * (S - J)


def run(command: Floats, rate: float, zone: float, **numbers: float) -> Floats:
    """The reading of a stem that begins at the first command."""
    stem = Stem.neutral(command.size, 1.0)
    stem.numbers[[stem_number.S, stem_number.J]] = S, J
    stem.numbers[[stem_number.INTEGRATES, stem_number.ZONE]] = rate, zone
    for name, value in numbers.items():
        stem.numbers[getattr(stem_number, name)] = value
    marks = np.zeros(command.size, dtype=np.uint8)
    marks[0] = 1
    never = np.full(command.size, command.size)
    out, _, _ = followed(stem, command, np.full(command.size, command[0]), marks, (never, never))
    return np.asarray(out)


def by_hand(command: Floats, rate: float, zone: float) -> Floats:
    """The same in equations written here: Choudhury's element with ``F = p + v - x``."""
    x, integral, moving, side = command[0], 0.0, False, 0.0
    out = np.empty(command.size)
    out[0] = x
    for k in range(1, command.size):
        if abs(command[k - 1] - x) > zone:
            integral += rate * (command[k - 1] - x)
        force = command[k] + integral - x
        moving = moving and side * force - SLIDING > 1e-9
        if not moving and abs(force) > LEVEL:
            moving, side = True, np.sign(force)
        if moving:
            x += side * max(side * force - SLIDING, 0.0)
        out[k] = x
    return out


def wave(seed: int, samples: int = 900) -> Floats:
    """A loop's OP: waves, and holds between them."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples)
    swing = 6.0 * np.sin(2.0 * np.pi * t / 140.0) + 3.0 * np.sin(2.0 * np.pi * t / 333.0)
    held = np.repeat(swing[::60], 60)[:samples]
    return np.asarray(50.0 + np.where((t // 180) % 2 == 0, swing, held + rng.normal()))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000), st.floats(0.005, 0.2), st.floats(0.0, 4.0))
def test_the_run_is_choudhurys_element_with_the_integral(
    seed: int, rate: float, zone: float
) -> None:
    """Sample by sample."""
    command = wave(seed)
    np.testing.assert_allclose(
        run(command, rate, zone), by_hand(command, rate, zone), rtol=0.0, atol=1e-7
    )


@pytest.mark.parametrize("numbers", [{}, {"PLAY": 0.8}, {"GROWTH": 0.3}, {"CREEP": 0.001}], ids=str)
def test_without_end_the_integral_time_is_a_plain_stem(numbers: dict[str, float]) -> None:
    """To the last bit where there is none, and sample by sample where it is very long."""
    command = wave(3)
    plain = run(command, 0.0, 0.0, **numbers)
    np.testing.assert_array_equal(run(command, 0.0, 2.0, **numbers), plain)
    never_outside = run(command, 0.5, 40.0, **numbers)
    np.testing.assert_array_equal(never_outside, plain)
    slow = np.abs(run(command, 1e-12, 0.0, **numbers) - plain)
    assert slow.max() < 1e-6
    assert np.abs(run(command, 0.05, 0.0, **numbers) - plain).max() > 0.5


def test_a_resting_stem_lets_go_without_a_change_of_op() -> None:
    """Golden: 2 % beyond a stem at rest, with 20 s, the force of 3 % is there after ten samples; it
    slides to 2 % behind its force, and there within its zone it stays."""
    command = np.full(400, 52.0)
    command[0] = 50.0
    seen = run(command, 1 / 20.0, 1.0)
    assert np.flatnonzero(seen > 50.0)[0] == 12
    assert seen[12] == pytest.approx(51.1)
    assert np.ptp(seen[12:]) == 0.0


def test_without_a_zone_it_hunts() -> None:
    """At a held OP a stem that sticks again goes to and fro about it for ever, by J each time."""
    command = np.full(3000, 52.0)
    command[0] = 50.0
    late = run(command, 1 / 20.0, 0.0, RESTICK=0.5)[1000:]
    assert late.max() > 52.0 > late.min()
    assert np.count_nonzero(np.diff(late)) > 5
    assert np.ptp(late) >= 0.9 * J


@given(st.floats(-50.0, 50.0), st.floats(0.0, 100.0), st.floats(0.0, 100.0), st.floats(0.0, 0.3))
def test_the_pressure_lies_between_none_and_that_of_the_supply(
    integral: float, command: float, x: float, rate: float
) -> None:
    """However long the stem is held; within the zone the integral stands."""
    after = integral_after(integral, command, x, 1.0, rate, 1.0)
    if rate == 0.0 or abs(command - x) <= 1.0:
        assert after == integral
    else:
        assert -25.0 - 1e-9 <= command + after <= 125.0 + 1e-9
