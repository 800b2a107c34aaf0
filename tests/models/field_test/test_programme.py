"""Programmes of OP: they never leave the limits, begin and end where OP is, and their times add
up."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from stemwatch.models.field_test.programme import (
    LEAD_S,
    REST_S,
    Programme,
    TestLimits,
    possible_moves,
)

amplitudes = st.floats(0.2, 30.0)
openings = st.floats(0.0, 100.0)


@given(amplitude=amplitudes, op=openings, least_hold_s=st.floats(0.1, 60.0), data=st.data())
@example(amplitude=5.0, op=94.95, least_hold_s=1.0, data=None)
@example(amplitude=0.2, op=50.0, least_hold_s=1.0, data=None)
@example(amplitude=5.0, op=2.0, least_hold_s=1.0, data=None)
def test_no_sequence_of_moves_leaves_the_limits(amplitude, op, least_hold_s, data):
    """Whatever moves follow each other, OP stays within its limits and ends where it began."""
    limits = TestLimits(amplitude=amplitude)
    down, up = limits.room(op)
    moves = possible_moves(down, up, limits.duration_s, least_hold_s)
    programme = Programme()
    count = 0 if data is None or not moves else data.draw(st.integers(0, 3))
    for move in [data.draw(st.sampled_from(moves)) for _ in range(count)] or moves[:3]:
        programme = programme.plus(move)
    values = programme.values()
    changes = np.array([value.change for value in values])
    assert changes[0] == 0.0
    assert changes[-1] == 0.0
    assert np.all(np.abs(changes) <= amplitude + 1e-9)
    if limits.op_low <= op <= limits.op_high:
        assert np.all(op + changes >= limits.op_low - 1e-9)
        assert np.all(op + changes <= limits.op_high + 1e-9)
    times = [value.at_s for value in values]
    assert all(b > a for a, b in pairwise(times))


@given(amplitude=st.floats(0.5, 20.0), interval_s=st.floats(0.5, 30.0))
@example(amplitude=5.0, interval_s=1.0)
def test_times_add_up(amplitude, interval_s):
    """The length is that of all values and rests, and every move fits the time that was allowed."""
    moves = possible_moves(amplitude, amplitude, 900.0, interval_s)
    assert moves
    for move in moves:
        assert LEAD_S + move.duration_s + REST_S <= 900.0
    programme = Programme(moves=tuple(moves[:3]))
    total = LEAD_S + sum(len(m.changes) * m.hold_s + REST_S for m in moves[:3])
    assert programme.duration_s == pytest.approx(total)
    changes = programme.changes(interval_s)
    assert changes.size == int(np.ceil(total / interval_s - 1e-9))
    assert changes[0] == changes[-1] == 0.0
    last = programme.values()[-1]
    assert last.at_s + programme.moves[-1].hold_s + REST_S == pytest.approx(total)


def test_samples_hold_the_value_that_was_set_last():
    """Between two values OP is held."""
    programme = Programme(moves=tuple(possible_moves(5.0, 5.0, 600.0, 1.0)[3:5]))
    changes = programme.changes(1.0)
    for k, second in enumerate(range(changes.size)):
        due = [value.change for value in programme.values() if value.at_s <= second]
        assert changes[k] == due[-1]


def test_where_op_has_no_room_there_is_no_move():
    """A tenth of a percent is no room; at the upper limit there is room downwards only."""
    down, up = TestLimits(op_low=40.0, op_high=40.1).room(40.0)
    assert possible_moves(down, up, 600.0, 1.0) == []
    assert TestLimits().room(99.0) == (5.0, 0.0)


@pytest.mark.parametrize(
    ("limits", "says"),
    [
        ({"amplitude": 0.1}, "amplitude"),
        ({"amplitude": 60.0}, "amplitude"),
        ({"duration_s": 30.0}, "duration"),
        ({"pv_upset": 0.0}, "PV upset"),
        ({"op_low": 60.0, "op_high": 40.0}, "OP limits"),
    ],
)
def test_limits_that_leave_no_room_say_what_was_expected(limits, says):
    """A limit without sense names itself, what was received and what was expected."""
    with pytest.raises(ValueError, match=says) as error:
        TestLimits(**limits)
    assert "received" in str(error.value)
