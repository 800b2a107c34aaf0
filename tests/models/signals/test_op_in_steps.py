"""An OP that was set in steps is told from one that its recorder rounded by when the stem moves."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.record_checks.quality import assess
from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.signals.op_in_steps import op_is_set_in_steps
from stemwatch.models.stickslip.interval import with_jumps_of_steps
from stemwatch.models.stickslip.op_within_steps import op_within_steps
from stemwatch.models.verdict import Verdict

WAVE = np.array([0, 1, 2, 3, 2, 1, 0, -1, -2, -3, -2, -1], dtype=float)


def staircase(step: float, held: int = 40) -> Floats:
    """A stroke test: up and down in equal steps, each of them held."""
    return np.tile(np.repeat(50.0 + step * WAVE, held), 5)


def lagged(command: Floats, tau: float = 0.6) -> Floats:
    """A stem that follows by a lag of so many samples, a sample late."""
    stem = np.empty(command.size)
    stem[0] = command[0]
    for k in range(1, command.size):
        stem[k] = stem[k - 1] + (command[k - 1] - stem[k - 1]) * (1.0 - np.exp(-1.0 / tau))
    return stem


def recorded(op: Floats, stem: Floats) -> Recording:
    """OP and a position with a little noise, at 1 s, with a PV that follows the stem."""
    draw = np.random.default_rng(1)
    noise = 0.05 * draw.standard_normal((2, op.size))
    signals = {
        Role.OP: Signal.good(op, "OP"),
        Role.MV: Signal.good(stem + noise[0], "MV"),
        Role.PV: Signal.good(lagged(stem, 5.0) + noise[1], "PV"),
    }
    return Recording(valve="V", signals=signals, interval_s=1.0)


def stuck_by(command: Floats, half_band: float) -> Floats:
    """A stem that is dragged by its command, with play of so much to either side."""
    stem = np.empty(command.size)
    position = command[0]
    for k, value in enumerate(command):
        position = min(max(position, value - half_band), value + half_band)
        stem[k] = position
    return stem


@pytest.mark.parametrize("step", [1.0, 2.0, 10.0])
@pytest.mark.parametrize("half_band", [0.0, 1.5])
def test_the_steps_of_a_stroke_test_are_the_commands_own(step, half_band):
    """The stem moves after each step, or after those that leave its dead band: OP is not said to
    be coarse, and is not sought within its steps."""
    op = staircase(step)
    recording = recorded(op, lagged(stuck_by(op, half_band)))
    assert op_is_set_in_steps(recording)
    assert op_within_steps(recording) is None
    assert "quantisation" not in [effect.slug for effect in measured_record(recording).effects]
    assert not any("steps of" in reason for reason in assess(recording, Limits()).quality.reasons)


@pytest.mark.parametrize("half_band", [0.0, 1.5])
def test_the_steps_of_a_recorder_are_not(half_band):
    """A command that goes on between two stored values takes the stem with it."""
    command = 50.0 + 6.0 * np.sin(2.0 * np.pi * np.arange(2400.0) / 600.0)
    recording = recorded(np.round(command / 2.0) * 2.0, lagged(stuck_by(command, half_band)))
    assert not op_is_set_in_steps(recording)
    assert any("steps of 2 %" in reason for reason in assess(recording, Limits()).quality.reasons)


def test_a_few_steps_or_none_are_no_ground():
    """Fewer than eight steps show nothing, and neither does an OP that is never held."""
    op = staircase(2.0)
    assert not op_is_set_in_steps(recorded(op[:280], lagged(op)[:280]))
    smooth = 50.0 + np.cumsum(0.1 * np.random.default_rng(2).standard_normal(op.size))
    assert not op_is_set_in_steps(recorded(smooth, lagged(smooth)))


@pytest.mark.parametrize(
    "step", [5.0, *(pytest.param(step, marks=pytest.mark.long) for step in (2.0, 10.0))]
)
def test_a_healthy_valve_in_a_stroke_test_is_not_called_sticky(step):
    """Steps that go past any level at which a stem lets go do not show that level: with steps of
    5 or 10 % S may stay open, but a stem that settles on its command is not said to stick."""
    op = staircase(step)
    (screened,) = screen([Case(recording=recorded(op, lagged(op)))], Options(narx=False))
    assert screened.verdict in (Verdict.HEALTHY, Verdict.UNDETERMINED)
    assert screened.S.low is None or screened.S.low < 0.75


@pytest.mark.long
@pytest.mark.parametrize("tau", [0.3, 2.0])
@pytest.mark.parametrize("half_band", [0.0, 1.5])
def test_s_and_j_hold_whatever_jump_a_step_hides(half_band, tau):
    """A stem with a dead band of 3 % may also jump by 1 % at each step of 5 %, and one without a
    dead band by 4 %: the record is the same, a lag beside it or none."""
    op = staircase(5.0)
    recording = recorded(op, lagged(stuck_by(op, half_band), tau))
    (screened,) = screen([Case(recording=recording)], Options(narx=False))
    dead_band = 2.0 * half_band
    assert screened.S.low <= dead_band + 0.1
    assert screened.S.high >= min(dead_band + 4.0, 4.5)
    assert screened.J.low == 0.0
    if half_band:
        assert screened.verdict is Verdict.STICKY
    else:
        assert "an S of 0.0 % fits best" in screened.reason
        assert "cannot be excluded" in screened.reason
        assert "0.5 to 1 %" in screened.advice


@pytest.mark.parametrize(("dead_band", "largest"), [(0.0, 5.0), (3.0, 2.0), (6.0, 5.0)])
def test_jumps_of_steps_keep_the_dead_band(dead_band, largest):
    """J reaches what the step leaves beyond the dead band, S goes up with it."""
    S, J = np.full(2000, dead_band + 0.1), np.full(2000, 0.1)
    wider, jumps = with_jumps_of_steps(S, J, 5.0)
    assert wider - jumps == pytest.approx(np.full(2000, dead_band))
    assert 0.1 <= jumps.min() < 0.2
    assert jumps.max() == pytest.approx(largest, rel=0.01)
