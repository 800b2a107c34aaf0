"""Which of two signals rests while the other goes on."""

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.record_checks.wiring_checks import wiring_obstacles
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.stickslip.rests import Rests
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky, simulate_loop


def wired(op, mv) -> Recording:
    signals = {Role.OP: Signal.good(op, "OP", "%"), Role.MV: Signal.good(mv, "ZT", "%")}
    return Recording(valve="V", signals=signals, interval_s=1.0)


def exchanged(recording: Recording) -> Recording:
    return wired(recording.signals[Role.MV].values, recording.op.values)


def sticking_by_hand() -> Recording:
    """OP to and fro by 10 % in 40 s; the stem rests 4 % behind, and jumps by 4 % each 4 %."""
    clock = np.arange(3600)
    op = 50.0 + 10.0 * np.abs((clock / 40.0) % 2.0 - 1.0)
    mv = op.copy()
    for k in range(1, op.size):
        mv[k] = mv[k - 1] if abs(op[k] - mv[k - 1]) < 4.0 else op[k]
    noise = 0.02 * np.random.default_rng(1).standard_normal(op.size)
    return wired(op, mv + noise)


def rests(recording: Recording) -> Rests:
    return Rests.of(make_problem(recording))


def test_a_stem_rests_and_its_command_does_not():
    """Each half cycle of 40 s begins with a rest of 16 s; 90 half cycles, less the warm-up's."""
    recording = sticking_by_hand()
    seen, other_way = rests(recording), rests(exchanged(recording))
    assert seen.position >= 70
    assert seen.command == 0
    assert seen.of_position
    assert not seen.of_command
    assert (other_way.position, other_way.command) == (seen.command, seen.position)
    assert other_way.of_command
    assert not other_way.of_position


def test_neither_rests_where_the_stem_follows():
    """Noise that fills the band between the two is no rest."""
    rng = np.random.default_rng(2)
    op = 50.0 + np.cumsum(rng.standard_normal(3000)) * 0.2
    seen = rests(wired(op, op + 0.3 * rng.standard_normal(op.size)))
    assert not seen.of_position
    assert not seen.of_command


def test_a_recording_without_a_usable_sample_has_no_rests():
    """Nothing is scored, so nothing is counted."""
    problem = make_problem(sticking_by_hand())
    empty = replace(problem, block=np.full(problem.op.size, -1))
    assert Rests.of(empty) == Rests(0, 0)


STICKING = draw_sticky(3, 5151)


@pytest.mark.parametrize("place", range(len(STICKING)))
@pytest.mark.parametrize("late", [0, 5])
def test_a_resting_stem_is_not_mistaken_for_op_however_late_op_is(place, late):
    """And OP that rests in its place is found to be the position."""
    recording = simulate_loop(STICKING[place], 3).recording
    seen = rests(recording)
    assert seen.of_position
    values = recording.op.values
    moved = np.concatenate((np.full(late, values[0]), values[: values.size - late]))
    op = replace(recording.op, values=moved)
    as_stored = replace(recording, signals={**recording.signals, Role.OP: op})
    answer = [
        wiring_obstacle.slug
        for wiring_obstacle in wiring_obstacles(recording, as_stored if late else None)
    ]
    assert "tags_swapped" not in answer
    mv = recording.signals[Role.MV]
    swapped = replace(recording, signals={**recording.signals, Role.OP: mv, Role.MV: recording.op})
    assert rests(swapped).of_command
    assert [obstacle.slug for obstacle in wiring_obstacles(swapped)] == ["tags_swapped"]


def test_a_healthy_valve_is_not_said_to_be_swapped():
    """Where the valve hardly sticks, an exchange of OP and position cannot be shown."""
    healthy = next(loop for loop in draw_healthy(60, 7171) if loop.tag == "PIC-149")
    recording = simulate_loop(healthy, 1000 * 7171 + 49).recording
    assert wiring_obstacles(recording) == []
