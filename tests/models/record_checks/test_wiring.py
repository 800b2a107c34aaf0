"""Mixed-up tags and clocks that are minutes apart are found before the valve is judged."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.limits import Limits
from stemwatch.models.record_checks.quality import assess
from stemwatch.models.record_checks.validity_checks import related
from stemwatch.models.record_checks.wiring_checks import wiring_obstacles
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.signals.excitation import swing
from stemwatch.models.signals.signal_pairing import (
    moved_without_command,
    samples_exchanged,
    to_and_fro_at_the_end,
)
from stemwatch.models.stickslip.best_pairing import BEFORE, Pairing
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.valve_life import draw_lives
from stemwatch.models.verdict import Verdict

LOOPS = [
    *(loop for loop in draw_healthy(12, 5151) if "set points" in loop.story),
    *draw_sticky(3, 5151),
]


@pytest.fixture(scope="module", params=range(len(LOOPS)), ids=lambda at: LOOPS[at].tag)
def recording(request) -> Recording:
    """A healthy or a sticking valve, wired up rightly."""
    return simulate_loop(LOOPS[request.param], 3).recording


def wired(recording: Recording, **values) -> Recording:
    signals = dict(recording.signals)
    for role, samples in values.items():
        signals[Role(role)] = Signal.good(samples, signals[Role(role)].tag)
    return replace(recording, signals=signals)


def values(recording: Recording, role: Role):
    return recording.signals[role].values


def told(recording: Recording) -> list[str]:
    assessment = assess(recording, Limits())
    obstacles = assessment.obstacles or wiring_obstacles(assessment.recording)
    return [obstacle.slug for obstacle in obstacles]


def test_a_valve_that_is_wired_up_rightly_is_not_doubted(recording):
    """Sticking or not, its own command explains most of how the position moves."""
    pairing = Pairing.of(recording)
    assert pairing is not None
    assert pairing.explained(BEFORE).left < 0.5
    assert wiring_obstacles(recording) == []
    assert moved_without_command(recording) < 0.1
    assert not samples_exchanged(recording)


def test_a_limit_cycle_whose_pv_goes_with_op_better_than_its_stem_is_not_doubted():
    """An overshoot in quick cycles: that PV goes with OP is the controller's doing. Another's PV,
    which no controller of this loop answers, leaves the doubt."""
    loop = draw_sticky(20, 6161)[19]
    cycling = simulate_loop(loop, 6161519).recording
    pairing = Pairing.of(cycling)
    assert pairing is not None
    assert pairing.explained(BEFORE).left > 0.3
    assert told(cycling) == []
    filtered = np.convolve(values(cycling, Role.OP), np.full(4, 0.25))[: len(cycling)]
    assert "tags_swapped" in told(wired(cycling, pv=filtered))


@cache
def slipping() -> Recording:
    """A flow loop whose stem slips without offset: PV goes with OP twice as well as the stem does,
    for the loop is quick and nothing sticks in PV."""
    return simulate_loop(draw_sticky(15, 6161)[14], 6_161_514).recording


def test_a_stem_that_rests_and_jumps_towards_its_command_is_not_doubted() -> None:
    """Such a stem follows its command without delay, whatever else is correlated with OP. The same
    position a minute late rests and jumps at other times, and is doubted.
    """
    recording = slipping()
    pairing = Pairing.of(recording)
    assert pairing is not None
    assert pairing.slips_to_its_command
    assert pairing.explained(BEFORE).left > 0.3
    assert told(recording) == []
    mv = values(recording, Role.MV)
    late = wired(recording, mv=np.concatenate((np.full(60, mv[0]), mv[:-60])))
    assert told(late) != []


def test_another_pv_does_not_make_a_slipping_stem_doubtful() -> None:
    """A PV that repeats OP through a filter."""
    recording = slipping()
    op = values(recording, Role.OP)
    filtered = np.convolve(op, np.full(4, 0.25))[: op.size]
    assert told(wired(recording, pv=filtered)) == []


@pytest.mark.parametrize("width", [3.5, 4.1, 4.4])
def test_play_of_any_width_is_explained_by_its_own_command(width: float) -> None:
    """Play with little noise on the reading: an S that is 10 % off leaves half of the movement, so
    that the true one has to be tried. Such a valve was refused as one with another clock."""
    draw = np.random.default_rng(0)
    seconds = np.arange(3600.0)
    op = 50.0 + 2.6 * np.sin(seconds / 60.0) + 4.0 * np.sin(seconds / 900.0)
    op += 0.1 * draw.standard_normal(seconds.size)
    stem, position = op[0], np.empty_like(op)
    for at, command in enumerate(op):
        stem = np.clip(stem, command - width / 2.0, command + width / 2.0)
        position[at] = stem
    signals = {
        Role.OP: Signal.good(op, "OP"),
        Role.MV: Signal.good(position + 0.05 * draw.standard_normal(seconds.size), "MV"),
    }
    recording = Recording(valve="V", signals=signals, interval_s=1.0)
    pairing = Pairing.of(recording)
    assert pairing is not None
    best = pairing.explained(BEFORE[:1])
    assert best.left < 0.2
    assert best.S == pytest.approx(width, rel=0.05)


@pytest.mark.parametrize(("late", "how"), [(120, "after OP"), (-120, "before OP")])
def test_clocks_minutes_apart_are_found_with_their_difference(recording, late, how):
    """A position two minutes late or early is found, or does not go with OP at all."""
    at = np.clip(np.arange(len(recording)) - late, 0, len(recording) - 1)
    apart = wired(recording, mv=values(recording, Role.MV)[at])
    assessment = assess(apart, Limits())
    obstacles = assessment.obstacles or wiring_obstacles(assessment.recording)
    assert obstacles[0].slug in ("clocks_apart", "position_unrelated")
    if obstacles[0].slug == "clocks_apart":
        assert how in obstacles[0].reason


@pytest.mark.parametrize("source", [Role.PV, Role.SP])
def test_a_tag_that_is_mapped_twice_is_named(recording, source):
    """PV or SP in the place of the position or of OP is said to be that; a set point that nobody
    moved to stand still there."""
    as_position = wired(recording, mv=values(recording, source))
    as_command = wired(recording, op=values(recording, source))
    if swing(values(recording, source)) == 0.0:
        assert source is Role.SP
        assert told(as_position) == ["position_still"]
        assert told(as_command) == ["op_still"]
        return
    assert told(as_position)[0] in (f"position_is_{source.value}", "position_coarse")
    assert told(as_command)[0] == f"op_is_{source.value}"


@pytest.mark.parametrize("scale", [(0.16, 4.0), (-1.0, 100.0), (0.01, 0.0)])
@pytest.mark.parametrize("late", [0, 12])
def test_a_copy_of_op_is_known_on_any_scale_and_late(recording, scale, late):
    """An alias of OP in milliamperes, inverted or late is no position."""
    op = values(recording, Role.OP)
    copy = scale[0] * op[np.maximum(np.arange(op.size) - late, 0)] + scale[1]
    assert told(wired(recording, mv=copy))[0] == "position_is_op"


@pytest.mark.parametrize("lag", [5.0, 30.0])
@pytest.mark.parametrize("step", [0.0, 0.01])
def test_a_filtered_copy_of_op_is_known(recording, lag, step):
    """OP through a filter has no noise of its own, and is no position, rounded or not."""
    copy = values(recording, Role.OP).copy()
    for k in range(1, copy.size):
        copy[k] = copy[k - 1] + (copy[k] - copy[k - 1]) / lag
    if step:
        copy = np.round(copy / step) * step
    assert told(wired(recording, mv=copy))[0] == "position_is_op"


def test_a_limit_switch_is_no_position(recording):
    """A reading of two values says so."""
    mv = values(recording, Role.MV)
    switch = wired(recording, mv=np.where(mv > np.median(mv), 100.0, 0.0))
    assert "position_switch" in told(switch)


def test_a_switch_about_the_middle_of_op_is_no_copy_of_it(recording):
    """A switch at 50 % of a healthy valve is OP rounded to whole strokes, and no copy of OP."""
    op = values(recording, Role.OP)
    op = 50.0 + op - np.median(op)
    switch = wired(recording, op=op, mv=np.where(op > 50.0, 100.0, 0.0))
    assert told(switch) == ["position_switch"]


def test_steps_of_five_percent_are_too_coarse(recording):
    """A position in steps wider than the sticking that matters gets no verdict."""
    coarse = wired(recording, mv=5.0 * np.round(values(recording, Role.MV) / 5.0))
    assert told(coarse)[0] in ("position_coarse", "position_switch", "position_frozen")


def test_a_station_that_does_not_track_is_no_command(recording):
    """A position that moves while OP stands still is moved by something else."""
    held = np.repeat(50.0 + 4.0 * (np.arange(len(recording) // 200 + 1) % 3), 200)
    station = wired(recording, op=held[: len(recording)])
    assert told(station)[0] == "op_not_followed"


def test_a_stem_that_turns_round_while_op_rests_at_its_end_is_moved_by_another() -> None:
    """OP of a split range's other valve rests at 0 for less than a minute each time."""
    k = np.arange(len(slipping()))
    command = 50.0 + 30.0 * np.sin(2.0 * np.pi * k / 80.0)
    position = command + 0.05 * np.random.default_rng(1).standard_normal(k.size)
    own = wired(slipping(), op=command, mv=position)
    other = wired(own, op=np.clip(2.0 * (command - 50.0), 0.0, 100.0))
    assert to_and_fro_at_the_end(own) == 0.0
    assert moved_without_command(other) < 0.15
    assert to_and_fro_at_the_end(other) > 0.3
    assert "op_not_followed" in told(other)


def exchanged(recording: Recording) -> Recording:
    """OP and position under each other's name."""
    return wired(recording, op=values(recording, Role.MV), mv=values(recording, Role.OP))


@pytest.mark.long
def test_the_controller_tells_that_op_and_position_of_a_healthy_valve_are_exchanged():
    """What answers PV and set point is the output, however little the valve sticks; a position
    that is recorded right is never taken for it, nor beside an OP in steps of 0.25 %."""
    stories = ("badly tuned", "oscillating")
    for loop in draw_healthy(24, 6161):
        recording = simulate_loop(loop, 3).recording
        coarse = np.round(values(recording, Role.OP) / 0.25) * 0.25
        assert "tags_swapped" not in told(recording) + told(wired(recording, op=coarse))
        if any(story in loop.story for story in stories):
            assert told(exchanged(recording)) == ["tags_swapped"]


def test_swapped_tags_of_a_sticking_valve_are_never_healthy_for_sure():
    """OP and position exchanged: reported, or at least not called healthy."""
    sticking = simulate_loop(draw_sticky(3, 5151)[2], 3).recording
    swapped = wired(sticking, op=values(sticking, Role.MV), mv=values(sticking, Role.OP))
    (screening,) = screen([Case(recording=swapped)], Options(narx=False, mismatch=False))
    assert screening.verdict is not Verdict.HEALTHY


def venting(seed: int, day: int) -> Recording:
    """A window of the fourteenth valve of the alert trial, which vents at no more than 0.6 %/s."""
    life = draw_lives(14, 90, seed)[13]
    assert life.has_cause(day)
    return simulate_loop(life.on(day, 1800.0), life.seed).recording


@pytest.mark.parametrize(("seed", "day"), [(5151, 14), (8181, 15), (9393, 14)])
def test_a_position_that_follows_slowly_one_way_is_its_own_valves(seed, day):
    """A blocked exhaust holds the stem off its command, on one side, and PV goes with OP better."""
    slow = venting(seed, day)
    pairing = Pairing.of(slow)
    assert pairing is not None
    assert pairing.explained(BEFORE).left > 0.5
    assert pairing.has_top_speed
    assert told(slow) == []


def test_a_position_too_slow_to_be_correlated_is_its_own_valves():
    """The loop cycles faster than the stem can vent."""
    slow = venting(7171, 27)
    assert related(slow) < 0.5
    assert told(slow) == []


def test_no_top_speed_explains_another_position(recording):
    """Nor one that comes minutes late, nor an exchange of the two."""
    later = np.roll(values(recording, Role.MV), 300)
    other = values(venting(5151, 14), Role.MV)[: len(recording)]
    for position in (later, np.pad(other, (0, len(recording) - other.size), mode="edge")):
        pairing = Pairing.of(wired(recording, mv=position))
        assert pairing is not None
        assert not pairing.has_top_speed
    slow = venting(5151, 14)
    swapped = wired(slow, op=values(slow, Role.MV), mv=values(slow, Role.OP))
    pairing = Pairing.of(swapped)
    assert pairing is not None
    assert not pairing.has_top_speed
