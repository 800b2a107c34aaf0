"""OP that the archive stored late against the position."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.recording import Quality, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.stickslip.clock_shift import behind_controller, brought_forward, find_op_late
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.studies.simulator.hidden import draw_nulls
from stemwatch.service.studies.robustness import draw_valves

LATE = 5


@cache
def valves():
    """Four sticking and four healthy ones; drawing them takes seconds."""
    return draw_valves(4, 8484)


@cache
def recorded(place: int):
    """A valve, sticking below 4 and healthy above, and what was recorded of it."""
    valve = valves()[place]
    return valve, simulate_loop(valve.case.loop, valve.case.seed).recording


def later(recording, role: Role, samples: int):
    """The recording with one signal stored late."""
    values = recording.signals[role].values
    moved = np.concatenate((np.full(samples, values[0]), values[:-samples]))
    signals = {**recording.signals, role: Signal.good(moved, recording.signals[role].tag)}
    return replace(recording, signals=signals)


# A sticking and a healthy valve in every run.
PLACES = [
    index if index in (0, 4) else pytest.param(index, marks=pytest.mark.long) for index in range(8)
]


@pytest.mark.parametrize("place", PLACES)
def test_a_late_command_is_found_to_a_fraction_of_a_sample(place):
    """For sticking and healthy valves; the remaining error is the controller's scan and the air
    lag.
    """
    _, recording = recorded(place)
    late_s = find_op_late(later(recording, Role.OP, LATE))
    assert late_s == pytest.approx(LATE, abs=0.75)


@pytest.mark.parametrize("place", PLACES)
def test_a_position_far_ahead_is_found_by_more_than_was_tried_first(place):
    """A position 20 s ahead of OP and PV: 14 s is the most of the shifts tried first. By the stem
    alone a smaller S looks much like a lateness, so that it may be some seconds off."""
    _, recording = recorded(place)
    late = later(later(recording, Role.OP, 20), Role.PV, 20)
    late = later(late, Role.SP, 20)
    assert find_op_late(late) == pytest.approx(20, abs=3.5)


@pytest.mark.parametrize("samples", [4, 11])
@pytest.mark.parametrize("place", PLACES)
def test_the_controller_law_shows_how_late_op_is(place, samples):
    """OP responds to PV and set point at once, whatever the valve does."""
    _, recording = recorded(place)
    result = behind_controller(later(recording, Role.OP, samples))
    assert result.samples == pytest.approx(samples, abs=0.5)
    assert behind_controller(recording).samples == 0.0
    assert behind_controller(later(recording, Role.MV, samples)).samples == 0.0


def test_without_pv_or_movement_the_controller_law_shows_nothing():
    """No PV, a PV that stands still, or a record too short for it."""
    _, recording = recorded(0)
    late = later(recording, Role.OP, LATE)
    without = {role: item for role, item in late.signals.items() if role is not Role.PV}
    still = Signal.good(np.full(len(late), 50.0), "PV")
    assert behind_controller(replace(late, signals=without)).samples == 0.0
    assert behind_controller(replace(late, signals={**without, Role.PV: still})).samples == 0.0
    assert behind_controller(late.part(0, 100)).samples == 0.0
    assert find_op_late(replace(late, signals=without)) == pytest.approx(LATE, abs=0.75)


def test_the_controller_law_works_with_holes_in_the_record():
    """A tenth of PV's samples are bad, and OP has a hole of a minute."""
    _, recording = recorded(0)
    late = later(recording, Role.OP, LATE)
    n = len(late)
    bad = np.random.default_rng(1).random(n) < 0.03
    hole = (np.arange(n) >= 900) & (np.arange(n) < 960)
    signals = dict(late.signals)
    for role, removed in ((Role.PV, bad), (Role.OP, hole)):
        signal = late.signals[role]
        signals[role] = replace(
            signal,
            values=np.where(removed, np.nan, signal.values),
            quality=np.where(removed, Quality.BAD, signal.quality),
        )
    assert behind_controller(replace(late, signals=signals)).samples == LATE


def test_a_pv_with_another_clock_does_not_shift_op():
    """OP and position agree, PV is ahead: the stem contradicts what the controller seems to say."""
    _, recording = recorded(0)
    pv, sp = recording.signals[Role.PV], recording.signals[Role.SP]
    ahead = {
        role: Signal.good(np.append(item.values[LATE:], np.full(LATE, item.values[-1])), item.tag)
        for role, item in ((Role.PV, pv), (Role.SP, sp))
    }
    early = replace(recording, signals={**recording.signals, **ahead})
    assert behind_controller(early).samples == LATE
    assert find_op_late(early) == 0.0


@pytest.mark.parametrize("place", PLACES)
def test_clocks_that_agree_stay_as_they_are(place):
    """A position that is stored late, which looks like a dead time, is not shifted either."""
    _, recording = recorded(place)
    assert find_op_late(recording) == 0.0
    assert find_op_late(later(recording, Role.MV, 3)) == 0.0


@pytest.mark.long
def test_S_and_J_do_not_depend_on_a_late_stored_command():
    """Verdict and numbers stay, and a sentence says that OP was shifted."""
    valve, recording = recorded(0)
    options = Options(narx=False)
    plain, late = (
        screen([Case(recording=item)], options)[0]
        for item in (recording, later(recording, Role.OP, LATE))
    )
    assert late.verdict is plain.verdict
    assert late.S.value == pytest.approx(plain.S.value, abs=0.15)
    assert late.S.low <= valve.S <= late.S.high
    assert any(
        "stored" in decision and "late" in decision for decision in late.provenance.decisions
    )
    assert "late_command" in [record_effect.slug for record_effect in late.mismatch.record_effects]
    assert late.mismatch.finding is plain.mismatch.finding


def test_explain_finds_it_by_itself():
    """And says it in seconds of the plant, whatever the recording's own clock."""
    _, recording = recorded(1)
    slow = replace(later(recording, Role.OP, LATE), interval_s=0.1)
    (effect,) = (
        record_effect
        for record_effect in explain(slow).record_effects
        if record_effect.slug == "late_command"
    )
    assert effect.parameters["late_s"] == pytest.approx(0.1 * LATE, abs=0.075)


def test_samples_without_op_after_the_shift_are_left_out():
    """Shifting loses the last samples and moves the others; no value is invented."""
    case = draw_nulls(1, 8485, "routine")[0]
    recording = simulate_loop(replace(case.loop, duration_s=600.0), case.seed).recording
    moved = brought_forward(recording, 2.0)
    n = len(recording)
    assert np.array_equal(moved.op.values[: n - 2], recording.op.values[2:])
    assert not moved.op.usable[n - 2 :].any()
    half = brought_forward(recording, 1.5)
    middle = 0.5 * (recording.op.values[1:-1] + recording.op.values[2:])
    assert half.op.values[: n - 2] == pytest.approx(middle)
    assert brought_forward(recording, 0.0) is recording
