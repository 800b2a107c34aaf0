"""Whether a position belongs to a command: copies, strangers, and true pairs."""

import numpy as np
import pytest

from stemwatch.models.limits import Limits
from stemwatch.models.record_checks.quality import assess
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.signals.first_order_lag import first_order_lag
from stemwatch.models.signals.signal_pairing import (
    correlation,
    delayed_correlation,
    is_copy,
    moved_without_command,
    sums_its_command,
)
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky, simulate_loop

RNG = np.random.default_rng(4)
OP = 50.0 + np.cumsum(0.2 * RNG.standard_normal(1800))


def pair(op, mv) -> Recording:
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "ZT")}
    return Recording(valve="V", signals=signals, interval_s=1.0)


@pytest.mark.parametrize(
    "mv",
    [OP, np.round(OP, 1), np.append(OP[:1], OP[:-1]), np.append(OP[:2], OP[:-2])],
    ids=["equal", "rounded", "one scan late", "two scans late"],
)
def test_a_copy_of_op_is_no_position(mv):
    """OP under another name is recognised, also rounded or recorded a scan or two late."""
    assert is_copy(pair(OP, mv))
    assert "position_is_op" == assess(pair(OP, mv), Limits()).obstacles[0].slug


def test_a_stem_that_follows_well_is_no_copy():
    """A position with noise and an offset of its own is a position."""
    assert not is_copy(pair(OP, OP + 0.3 + 0.03 * RNG.standard_normal(OP.size)))


def test_true_positions_go_with_their_command():
    """A sticking stem follows late, but it follows."""
    for index, loop in enumerate(draw_sticky(6, 17)):
        recording = simulate_loop(loop, index).recording
        assert delayed_correlation(recording) > 0.3
        assert "position_unrelated" not in [o.slug for o in assess(recording, Limits()).obstacles]


def test_the_position_of_another_valve_is_refused():
    """A position that is not correlated with OP is an obstacle with that reason."""
    other = 50.0 + 5.0 * np.sin(np.arange(OP.size) / 7.0) + 0.1 * RNG.standard_normal(OP.size)
    obstacle = assess(pair(OP, other), Limits()).obstacles[0]
    assert "position_unrelated" == obstacle.slug
    assert "another valve" in obstacle.reason


@pytest.mark.long
def test_a_position_that_sums_op_is_not_told_where_to_go():
    """The travel of an electric actuator by its pulses is their sum; a stem that is late, slow or
    sticks ends where its command is."""
    drive = np.cumsum(OP - OP.mean()) * 0.01 + 0.01 * RNG.standard_normal(OP.size)
    obstacle = assess(pair(OP, 50.0 + drive), Limits()).obstacles[0]
    assert "position_sums_op" == obstacle.slug
    assert "not the position that the valve is told" in obstacle.reason
    for lag in (3.0, 30.0, 100.0):
        assert not sums_its_command(pair(OP, first_order_lag(OP, lag)))
    for late in (1, 5, 30):
        assert not sums_its_command(pair(OP[:-late], OP[late:]))
        assert not sums_its_command(pair(OP[late:], OP[:-late]))
    for index, loop in enumerate([*draw_sticky(6, 17), *draw_healthy(6, 17)]):
        assert not sums_its_command(simulate_loop(loop, index).recording)


def test_correlation_of_what_does_not_move_is_zero():
    """A constant position has a correlation of zero."""
    still = pair(OP, np.full(OP.size, 50.0))
    assert (0.0, 0.0, False) == (correlation(still), delayed_correlation(still), is_copy(still))


@pytest.mark.parametrize("step", [0.5, 1.0])
def test_a_stem_that_moves_within_the_steps_of_a_coarse_op_does_not_move_alone(step):
    """A slow command whose stored OP stands still for minutes has moved within its step, and so
    has the stem; beside an OP that is stored as it is the same moves are its own."""
    clock = np.arange(7200)
    noise = 0.1 * np.random.default_rng(8).standard_normal(clock.size)
    slow = 50.0 + 0.9 * step * np.sin(clock / 150.0) + 1.5 * step * np.sin(clock / 1900.0)
    stem = slow + noise
    assert moved_without_command(pair(np.round(slow / step) * step, stem)) < 0.15
    still = 50.0 + 2.0 * (clock > 3600)
    alone = pair(still, stem + still - 50.0 + 1.5 * np.sin(clock / 150.0))
    assert moved_without_command(alone) > 0.15


def test_a_stem_that_overshoots_each_step_and_comes_to_rest_does_not_move_alone():
    """A positioner that swings past each step of a staircase for a minute is at rest at last; one
    that swings on is moved by something else."""
    since, step = np.arange(7200) % 180, np.arange(7200) // 180
    op = 50.0 + 3.0 * np.abs(step % 12 - 6)
    came = np.where(np.diff(op, prepend=op[0])[180 * step] >= 0.0, 1.0, -1.0)
    swung = came * np.sin(2.0 * np.pi * since / 100.0)
    noise = 0.05 * np.random.default_rng(8).standard_normal(op.size)
    settles = pair(op, op + 5.0 * swung * np.exp(-since / 50.0) + noise)
    assert moved_without_command(settles) < 0.15
    assert "op_not_followed" not in [found.slug for found in assess(settles, Limits()).obstacles]
    assert moved_without_command(pair(op, op + 2.0 * swung + noise)) > 0.15
